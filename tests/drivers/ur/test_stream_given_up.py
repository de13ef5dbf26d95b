"""After a fault the arm stays where it is, whatever is pressed on the pendant or the dashboard."""

import math
import time

import pytest
from ur_rig import (
    device_of,
    fault_of,
    press,
    push,
    recover,
    stream_of,
    streaming,
    swing,
    until,
)

from emulated_ur import EmulatedRobot
from orientd.errors import FeedbackError

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

STOPS = {"protective_stop": "", "safeguard": "release", "pause": "", "stop": ""}


def moved(robot, since):
    return math.dist(robot.state()["actual_q"], since)


def play(robot, *, unlock):
    """Unlock and play on the dashboard; the answers do not matter."""
    if unlock:
        until(
            lambda: (
                press(robot.host, "unlock protective stop")
                and robot.state()["safety_mode"] == "NORMAL"
            ),
            "the unlocked stop",
        )
    return press(robot.host, "play")


@pytest.mark.parametrize("order", STOPS)
@pytest.mark.parametrize("is_pushed", [False, True])
def test_arm_that_was_stopped_stays_when_somebody_presses_play(ur_robot, order, is_pushed):
    with stream_of(ur_robot.host) as stream:
        stream.run(0.4, rate=1.0)
        ur_robot.ask(order)
        until(lambda: stream.cycle() or stream.is_faulty, f"a fault of {order}")
        stream.run(0.3)
        ur_robot.wait_until(lambda s: s["is_still"])
        angles = (0.3, 0.1, 0.0, 0.0, 0.0, -0.2) if is_pushed else (0.0,) * 6
        stands = push(ur_robot, angles)
        if STOPS[order]:
            ur_robot.ask(STOPS[order])
        play(ur_robot, unlock=order == "protective_stop")
        stream.run(0.6)
        assert moved(ur_robot, stands) < 1e-6
        assert ur_robot.state()["runtime_state"] == "STOPPED"
        stream.driver.reset()
        stream.start()
        stream.run(0.3, rate=0.3)
        assert not stream.is_faulty


def test_controller_that_stands_still_is_sent_nothing_after_the_timeout(ur_robot):
    """Setpoints that pile up would reach the arm as one jump when the controller goes on."""
    with stream_of(ur_robot.host, feedback_timeout=0.1, link_timeout=2.0) as stream:
        stream.run(0.4, rate=0.5)
        before = ur_robot.state()["setpoints"]
        ur_robot.ask("freeze 0.4")
        problems = []
        ends = time.monotonic() + 0.3
        while time.monotonic() < ends:
            try:
                stream.driver.read()
            except FeedbackError as error:
                problems.append(str(error))
            # The servo goes on writing while it brakes.
            stream.send()
            time.sleep(0.002)
        assert f"no feedback from {ur_robot.host} for 0.1" in problems[0]
        frozen = ur_robot.wait_until(lambda s: s["setpoints"] > before)["ticks"]
        after = ur_robot.wait_until(lambda s: s["ticks"] > frozen + 20)
        assert 0 < after["setpoints"] - before < 0.11 / 0.002


def test_program_that_plays_during_a_fault_is_an_event(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append) as device:
        swing(device)
        streaming(device)
        ur_robot.ask("pause")
        fault_of(device)
        ended = ur_robot.wait_until(lambda s: s["runtime_state"] == "STOPPED")
        ur_robot.wait_until(lambda s: s["ticks"] > ended["ticks"] + 50)
        assert press(ur_robot.host, "load other.urp", "play") == "Starting program"
        until(
            lambda: device.snapshot() and any("another program" in str(event) for event in events),
            lambda: f"the event in {events}",
        )
        recover(device)


def test_robot_without_a_dashboard_has_its_program_ended_when_it_is_played(ur_host):
    with EmulatedRobot(ur_host, "--polyscope", "10.11") as robot, stream_of(ur_host) as stream:
        stream.run(0.4, rate=1.0)
        # A safety stop lets no other program take its place.
        robot.ask("safeguard")
        stream.run(0.3)
        stands = robot.wait_until(lambda s: s["is_still"])["actual_q"]
        robot.ask("release")
        robot.ask("play")
        stream.run(0.5)
        assert moved(robot, stands) < 0.02
        assert robot.state()["runtime_state"] == "STOPPED"
        assert "was played on the robot during the fault" in stream.driver.notices()[-1]
