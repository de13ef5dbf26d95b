"""Teach-in: an emulated arm and gimbal, moved by hand, and the motion through what was taken."""

import contextlib
import json
import os
import pty
import signal
import subprocess
import time
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import COMMAND, begin, orientd
from gimbal_bench import (
    SLOW_MACHINE,
    EmulatedGimbal,
    ExampleDaemon,
    GimbalDaemon,
    await_hold,
    seldom,
)
from harness import CycleLog, DaemonProcess, run_first, until

from emulated_ur import EmulatedRobot, LaunchError
from orientd import connect, motion_file
from orientd.errors import DeviceError, FeedbackError, OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import conjugate, exp, log, multiply

pytestmark = pytest.mark.world

MILLIRADIAN = 1e-3

JOINTS = [
    [0.0, -1.5708, 1.3963, -1.3963, -1.5708, 0.0],
    [0.03, -1.5708, 1.3963, -1.2, -1.4, 0.2],
    [0.05, -1.55, 1.3963, -1.3, -1.45, -0.1],
]
TURNS = [(1, 200), (2, 150), (3, -120), (1, -90)]


def measured_ns(cycle):
    return cycle.deadline_ns - cycle.feedback_age_ns


def replay(daemon, robot, file):
    """Run a motion file; return what was sent of it."""
    with contextlib.closing(CycleLog(daemon.socket)) as seen:
        summary = robot.move(motion_file.load(file)).wait()
        assert summary.outcome == pb.OUTCOME_DONE, summary
        cycles = seen.cycles()
    last = max(cycle.motion for cycle in cycles)
    return [cycle for cycle in cycles if cycle.motion == last]


def assert_passes(sent, q, position=None):
    """Check that the path of what was sent passes a pose within a milliradian, and a millimetre."""
    # Between two setpoints: a motion that resumes after a stall has other setpoints than planned.
    turns = log(multiply(conjugate(np.array(q)), np.array([cycle.q for cycle in sent])))
    places = np.array([cycle.position for cycle in sent])
    steps = np.diff(turns, axis=0)
    shares = -np.sum(turns[:-1] * steps, axis=1) / np.maximum(np.sum(steps**2, axis=1), 1e-30)
    shares = np.clip(shares, 0.0, 1.0)[:, None]
    misses = np.linalg.norm(turns[:-1] + shares * steps, axis=1)
    nearest = int(np.argmin(misses))
    assert misses[nearest] < MILLIRADIAN
    if position is not None:
        passed = places[:-1] + shares * np.diff(places, axis=0)
        assert np.linalg.norm(passed[nearest] - position) < 1e-3


@pytest.fixture
def teach():
    """Begin the command, and end it with the test whatever happens."""
    with contextlib.ExitStack() as stack:

        def begin_one(*arguments):
            process = stack.enter_context(begin("teach", *arguments, stdin=subprocess.PIPE))
            stack.callback(process.kill)
            return process

        yield begin_one


# Without a device that anybody could move.


@pytest.fixture(scope="module")
def loopback(tmp_path_factory):
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), lease=3.0) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


def test_a_device_that_cannot_be_moved_by_hand_says_so_and_follows_again(loopback):
    with connect(loopback.socket) as robot:
        with pytest.raises(OrientdError, match="'loopback' cannot be moved by hand"):
            robot.teach()
        assert robot.state().devices["arm"].state == pb.STATE_HOLDING


def test_a_signal_takes_a_keyframe_and_a_keyframe_can_be_removed(loopback, teach, tmp_path):
    file = tmp_path / "watched.json"
    teaching = teach(file, "--watch", "--socket", loopback.socket, "--name", "seen")
    assert "watched" in teaching.stdout.readline()
    for number in (1, 2):
        teaching.send_signal(signal.SIGUSR1)
        assert teaching.stdout.readline().startswith(f"{number} at ")
    teaching.stdin.write("remove\njump\n")
    teaching.stdin.flush()
    assert teaching.stdout.readline() == "removed 2\n"
    assert "expected take, remove, name or end, got 'jump'" in teaching.stdout.readline()
    # What was taken is there at once, and Ctrl-C ends it.
    assert len(json.loads(file.read_text())["keyframes"]) == 1
    teaching.send_signal(signal.SIGINT)
    output, _ = teaching.communicate(timeout=30)
    assert f"wrote {file}: 1 keyframes" in output
    assert motion_file.load(file).name == "seen"


@pytest.mark.real
def test_keys_on_a_terminal_take_name_remove_and_end(loopback, tmp_path):
    file = tmp_path / "keys.yaml"
    main, side = pty.openpty()
    command = [*COMMAND, "teach", str(file), "--watch", "--socket", str(loopback.socket)]
    everything = ""
    with subprocess.Popen(command, stdin=side, stdout=side, stderr=side) as process:
        os.close(side)
        for keys, said in (
            ("", "q ends"),
            (" ", "1 at 0.00 s"),
            ("\n", "2 at"),
            ("n", "name: "),
            ("grasp\n", "2 is called 'grasp'"),
            (" ", "3 at"),
            ("\x7f", "removed 3"),
            ("q", "2 keyframes"),
        ):
            os.write(main, keys.encode())
            printed = ""
            while said not in printed:
                printed += os.read(main, 4096).decode()
            assert r"\x1b" not in printed, "a code of the terminal is shown as text"
            everything += printed
        assert process.wait() == 0
    os.close(main)
    # The pose that is shown meanwhile leaves nothing beside a message.
    for said in ("1 at 0.00 s", "2 is called 'grasp'", "removed 3", "wrote "):
        assert f"\r{said}" in everything or f"\n{said}" in everything
    assert [one.name for one in motion_file.load(file).keyframes] == ["", "grasp"]


def test_an_old_file_is_not_written_over_and_nothing_taken_writes_none(loopback, tmp_path):
    file = tmp_path / "taught.yaml"
    arguments = ("teach", file, "--watch", "--socket", loopback.socket)
    refused = subprocess.run(
        [*COMMAND, *map(str, arguments)], input="end\n", capture_output=True, text=True, check=False
    )
    assert refused.returncode == 1
    assert "no keyframe was taken" in refused.stderr
    assert not file.exists()
    file.write_text("mine")
    refused = orientd(*arguments)
    assert "it is there already" in refused.stderr
    assert file.read_text() == "mine"


def test_feedback_that_has_stopped_is_no_pose(loopback):
    with connect(loopback.socket) as robot:
        teaching = robot.teach(by_hand=False)
        teaching.take()
        told = robot.state()
        told.devices["arm"].cycle.feedback_age_ns = 600_000_000
        teaching._robot = SimpleNamespace(state=lambda: told)
        with pytest.raises(DeviceError, match=r"has not said where it is for 0\.6 s"):
            teaching.take()
        assert len(teaching.keyframes) == 1


@pytest.fixture
def gimbal(tmp_path):
    pytest.importorskip("dynamixel_sdk")
    bus = EmulatedGimbal(tmp_path / "bus")
    daemon = None
    try:
        daemon = GimbalDaemon(tmp_path, bus.link).start()
        await_hold(daemon, "gimbal")
        yield bus, daemon
    finally:
        if daemon is not None:
            daemon.end()
        bus.end()


def test_a_gimbal_without_torque_is_taught_by_the_command_and_passes_every_pose_again(
    gimbal, teach, tmp_path
):
    bus, daemon = gimbal
    file = tmp_path / "taught.yaml"
    with connect(daemon.socket) as watching:
        state = watching.state
        teaching = teach(file, "--socket", daemon.socket)
        line = teaching.stdout.readline()
        assert "can be moved by hand" in line, state().devices["gimbal"].fault_text
        taken, taught = [], []
        for servo, turn in TURNS:
            assert bus.state(servo)["torque"] == 0
            goal = bus.state(servo)["position"] + turn
            bus.tell(f"turn {servo} {turn} 0.5")
            until(seldom(lambda: bus.state(servo)["position"] == goal), "the turn")  # noqa: B023
            here = [bus.state(number)["position"] for number in (1, 2, 3)]
            turned_ns = time.monotonic_ns()
            until(
                seldom(lambda: measured_ns(state().devices["gimbal"].cycle) > turned_ns),  # noqa: B023
                "feedback",
            )
            teaching.stdin.write("take\n")
            teaching.stdin.flush()
            assert teaching.stdout.readline().startswith(f"{len(taken) + 1} at ")
            taken.append(here)
            taught.append(to_quaternion(state().devices["gimbal"].cycle.feedback_q))
        teaching.stdin.write("name corner\nend\n")
        teaching.stdin.flush()
        assert "is called 'corner'" in teaching.stdout.readline()
        output, errors = teaching.communicate(timeout=30)
        assert f"wrote {file}: 4 keyframes" in output, errors
    assert bus.state(1)["torque"] == 1
    assert motion_file.load(file).keyframes[-1].name == "corner"
    with connect(daemon.socket) as robot:
        sent = replay(daemon, robot, file)
    for q in taught:
        assert_passes(sent, q)
    # Where it ends up is where it was turned to, in the servos' own ticks.
    assert [bus.state(number)["goal"] for number in (1, 2, 3)] == pytest.approx(taken[-1], abs=1)


# An arm, which goes on at 500 Hz until the last of these tests.


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    run = os.getpid()
    host = f"127.{1 + run // 200 % 250}.{1 + run % 200}.252"
    with EmulatedRobot(host) as robot:
        run_first(robot.process.pid)
        folder = tmp_path_factory.mktemp("arm")
        daemon = ExampleDaemon(folder, "ur.toml", ("127.0.0.2", host), *SLOW_MACHINE).start()
        try:
            await_hold(daemon, "arm")
            yield robot, daemon
        finally:
            daemon.end()


def takes(teaching, truths):
    """Take the last of *truths* as a keyframe once it is measured; return whether that worked."""
    # On a busy machine the measurement may be too old to be taken.
    with contextlib.suppress(FeedbackError):
        if np.allclose(teaching.pose().position, truths[-1][:3], atol=1e-9):
            teaching.take(f"pose {len(truths)}")
            return True
    return False


def test_an_arm_in_freedrive_is_taught_and_passes_every_pose_again(arm, tmp_path):
    emulated, daemon = arm
    push = "push {} {} {} {} {} {} 0.8"
    with connect(daemon.socket) as robot:
        with pytest.raises(LaunchError, match="freedrive is off"):
            emulated.ask(push.format(*JOINTS[1]))
        truths = []
        with robot.teach() as teaching:
            report = robot.state().devices["arm"]
            assert (report.state, report.is_free) == (pb.STATE_IDLE, True)
            for joints in JOINTS:
                emulated.ask(push.format(*joints))

                def has_arrived(state, joints=joints):
                    return np.allclose(state["actual_q"], joints, atol=1e-9)

                truths.append(emulated.wait_until(has_arrived)["actual_pose"])
                until(lambda: takes(teaching, truths), "a keyframe of what was measured")
        with pytest.raises(LaunchError, match="freedrive is off"):
            emulated.ask(push.format(*JOINTS[0]))
        report = robot.state().devices["arm"]
        assert (report.state, report.is_free) == (pb.STATE_HOLDING, False)
        file = tmp_path / "taught.yaml"
        request = teaching.save(file, "taught")
        assert motion_file.load(file) == request
        assert [one.name for one in request.keyframes] == ["pose 1", "pose 2", "pose 3"]
        sent = replay(daemon, robot, file)
    for truth in truths:
        assert_passes(sent, exp(truth[3:]), truth[:3])


def test_an_arm_is_held_again_when_whoever_taught_it_is_killed(arm, teach, tmp_path):
    _, daemon = arm

    def report():
        with connect(daemon.socket) as robot:
            return robot.state().devices["arm"]

    process = teach(tmp_path / "out.yaml", "--socket", daemon.socket)
    until(lambda: report().is_free, "the arm to be let go")
    process.kill()
    process.wait()
    until(lambda: report().state == pb.STATE_HOLDING, "the arm to hold again")
    assert not report().is_free
