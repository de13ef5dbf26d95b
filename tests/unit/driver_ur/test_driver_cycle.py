"""The driver's cycle, cycle by cycle, against a stand-in for the client library."""

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import pytest
from fake_library import HOST, JOINTS, FakeRobot

from orientd.driver import Setpoint
from orientd.errors import (
    AxisFaultError,
    DeviceFaultError,
    FeedbackError,
    LinkError,
    SpentLinkError,
)
from orientd.floats import exp, log, multiply
from orientd_ur.arm import MODELS
from orientd_ur.controller import RuntimeState
from orientd_ur.kinematics import Kinematics
from orientd_ur.link import VARIABLES
from orientd_ur.probe import Place

MS = 1_000_000


@pytest.fixture
def robot(monkeypatch):
    return FakeRobot().install(monkeypatch)


def enabled(robot, **options):
    driver = robot.driver(**options)
    start = driver.enable()
    robot.calls.clear()
    return driver, start


def cycle(driver, *, ms=2):
    driver.clock.advance(ms * MS)
    return driver.read()


def test_arm_is_where_the_controller_commands_it_to_be(robot):
    # The load bends the arm.
    bent = tuple(angle + 0.001 for angle in JOINTS)
    robot.pose, robot.joints = [0.0] * 6, list(bent)
    driver = robot.driver()
    start = driver.enable()
    assert start.position == (0.1, 0.2, 0.3)
    assert log(start.q) == pytest.approx((0.4, -0.2, 0.1))
    assert start.joints == bent
    assert start.time_ns == driver.clock.now_ns()
    arm = driver.mechanism(may_ask=False)
    q, position = arm.forward(JOINTS)
    assert (q, position) == (pytest.approx(start.q), pytest.approx(start.position))
    assert robot.calls[0] == ("receive", (HOST, -1.0, VARIABLES))
    assert robot.calls[1] == ("control", (HOST, -1.0, 1))


def test_arm_that_is_not_where_the_controller_commands_it_to_be_is_not_enabled(robot):
    robot.joints[1] += 0.3
    with pytest.raises(DeviceFaultError, match=r"joint shoulder is 17\.2 deg from where"):
        robot.driver().enable()


def test_arm_is_enabled_once_it_stands(robot):
    driver = robot.driver()
    coasts = iter(range(8))
    commanded = driver._link.commanded

    def moving():
        for _ in coasts:
            robot.target_joints[0] += 0.002
            robot.joints[0] += 0.002
            break
        return commanded()

    driver._link.commanded = moving
    assert driver.enable().joints[0] == pytest.approx(JOINTS[0] + 0.016)


def test_arm_that_does_not_come_to_rest_is_not_enabled(robot, monkeypatch):
    monkeypatch.setattr("orientd_ur.driver._COMING_TO_REST", 0.01)
    driver = robot.driver()

    def moving():
        robot.target_joints[0] += 0.002
        return tuple(robot.target_joints), robot.target_pose

    driver._link.commanded = moving
    with pytest.raises(DeviceFaultError, match="does not come to rest"):
        driver.enable()


def test_tool_payload_and_watchdog_are_set_if_they_are_given(robot):
    driver = robot.driver(
        tcp_offset=[0, 0, 0.1, 0, 0, 0], payload_mass=2.0, payload_cog=[0, 0, 0.05], watchdog_hz=5
    )
    driver.enable()
    orders = [call for call in robot.calls if call[0].startswith("set")]
    assert orders == [
        ("setTcp", ([0.0, 0.0, 0.1, 0.0, 0.0, 0.0],)),
        ("setPayload", (2.0, [0.0, 0.0, 0.05])),
        ("setWatchdog", (5.0,)),
    ]
    _, robot.calls[:] = robot.driver().enable(), [c for c in robot.calls if c[0] == "setTcp"]
    assert len(robot.calls) == 1


def test_order_that_the_program_does_not_carry_out_is_a_fault_in_words(robot):
    robot.answers["setWatchdog"] = False
    with pytest.raises(DeviceFaultError, match="did not carry out setWatchdog"):
        robot.driver().enable()
    robot.answers["setWatchdog"] = lambda: robot.modes.__setitem__(1, 3)
    with pytest.raises(DeviceFaultError, match="protective stop: look for its cause"):
        robot.driver().enable()


def test_packages_and_programs_that_come_late_are_waited_for(robot):
    robot.late["timestamp"] = 5
    driver = robot.driver()
    robot.late["timestamp"] = 5
    driver.enable()
    driver.disable()
    robot.modes[2] = int(RuntimeState.STOPPED)

    def play():
        robot.modes[2], robot.late["program"] = int(RuntimeState.PLAYING), 3
        return True

    robot.answers["reuploadScript"] = play
    robot.calls.clear()
    driver.enable()
    assert robot.called("reuploadScript") == [()]
    driver.disable()
    driver.enable()
    assert robot.called("reuploadScript") == [()]


def test_arm_is_none_if_nobody_says_which_it_is_and_refused_if_it_is_another(robot, monkeypatch):
    def silent(*_):
        raise LinkError("it does not say")

    monkeypatch.setattr("orientd_ur.robot.ask", silent)
    driver, _ = enabled(robot)
    assert driver.mechanism(may_ask=True) is None
    driver, _ = enabled(robot, model="ur10e")
    assert driver.mechanism(may_ask=True).name == "ur10e"
    monkeypatch.setattr("orientd_ur.robot.ask", lambda *_: MODELS["ur3"].arm())
    with pytest.raises(LinkError, match="has a ur3, `model` says ur10e"):
        robot.driver(model="ur10e")
    driver, _ = enabled(robot, check_joints=False, model="ur10e")
    assert driver.mechanism(may_ask=True) is None


def test_feedback_is_what_was_measured_in_the_frame_of_the_tool(robot):
    driver, _ = enabled(robot)
    robot.pose = [0.5, 0.6, 0.7, 0.0, 0.0, math.pi / 2]
    robot.speed = [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    robot.joints = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    found = cycle(driver)
    assert found.q == pytest.approx(exp((0.0, 0.0, math.pi / 2)))
    assert found.omega_body == pytest.approx((2.0, -1.0, 3.0))
    assert found.position == (0.5, 0.6, 0.7)
    assert found.joints == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert found.time_ns == driver.clock.now_ns()


@pytest.mark.parametrize(
    ("scaling", "fraction", "found"), [(0.5, 0.5, 0.25), (2.0, 1.0, 1.0), (-1.0, 1.0, 0.0)]
)
def test_speed_is_slider_times_limiter_between_0_and_1(robot, scaling, fraction, found):
    driver, _ = enabled(robot)
    robot.scaling, robot.fraction = scaling, fraction
    cycle(driver)
    assert driver.speed_scaling == found


def test_setpoint_is_sent_as_a_rotation_vector_with_the_options_of_the_motion(robot):
    driver, start = enabled(robot, lookahead=0.05, gain=500)
    q = multiply(start.q, exp((0.0, 0.3, 0.0)))
    driver.write(Setpoint(0, q, position=(0.2, 0.3, 0.4)))
    ((pose, speed, acceleration, seconds, lookahead, gain),) = robot.called("servoL")
    assert pose[:3] == [0.2, 0.3, 0.4]
    assert pose[3:] == pytest.approx(log(q), abs=1e-12)
    assert (speed, acceleration, seconds, lookahead, gain) == (0.0, 0.0, 0.002, 0.05, 500.0)
    driver.tune({"gain": 900, "lookahead": 0.2})
    driver.write(Setpoint(0, q, position=(0.2, 0.3, 0.4)))
    assert robot.called("servoL")[-1][3:] == (0.002, 0.2, 900.0)
    driver.tune({})
    driver.write(Setpoint(0, q, position=(0.2, 0.3, 0.4)))
    assert robot.called("servoL")[-1][3:] == (0.002, 0.05, 500.0)


def test_rotation_vector_goes_on_from_the_one_the_controller_commands(robot):
    robot.target_pose = [0.1, 0.2, 0.3, 0.0, 0.0, 3.6]
    driver, start = enabled(robot)
    driver.write(Setpoint(0, start.q, position=start.position))
    assert robot.called("servoL")[0][0][3:] == pytest.approx((0.0, 0.0, 3.6))


# Feedback that does not come


def test_clock_that_stands_still_is_missing_feedback_and_nothing_more_is_sent(robot):
    driver, start = enabled(robot, feedback_timeout=0.1, link_timeout=0.5)
    cycle(driver)
    robot.is_frozen = True
    for _ in range(50):
        cycle(driver)
    driver.write(Setpoint(0, start.q, position=start.position))
    assert len(robot.called("servoL")) == 1
    with pytest.raises(FeedbackError, match=r"no feedback from 127\.0\.0\.9 for 0\.102 s"):
        cycle(driver)
    driver.write(Setpoint(0, start.q, position=start.position))
    assert len(robot.called("servoL")) == 1
    robot.is_frozen = False
    cycle(driver)
    driver.enable()
    driver.write(Setpoint(0, start.q, position=start.position))
    assert len(robot.called("servoL")) == 2


def test_clock_that_stands_still_for_long_is_a_link_that_nobody_touches_again(robot):
    driver, start = enabled(robot, feedback_timeout=0.1, link_timeout=0.5)
    cycle(driver)
    robot.is_frozen = True
    for _ in range(3):
        cycle(driver, ms=30)
    with pytest.raises(SpentLinkError, match="has stood still for"):
        cycle(driver, ms=450)
    robot.calls.clear()
    for call in (driver.read, lambda: driver.write(Setpoint(0, start.q)), driver.reset):
        with pytest.raises(SpentLinkError, match="was lost"):
            call()
    driver.disable()
    driver.close()
    assert not robot.calls


def test_pause_of_our_own_is_no_missing_feedback(robot):
    driver, _ = enabled(robot, feedback_timeout=0.1)
    cycle(driver)
    robot.is_frozen = True
    cycle(driver, ms=300)
    cycle(driver)
    with pytest.raises(FeedbackError):
        cycle(driver)
    robot.is_frozen = False
    cycle(driver)
    robot.is_frozen = True
    cycle(driver)
    cycle(driver, ms=90)


def test_controller_that_sends_nothing_is_not_opened_nor_enabled(robot, monkeypatch):
    monkeypatch.setattr("orientd_ur.driver._FIRST_PACKAGES", 0.02)
    driver = robot.driver()
    robot.is_frozen = True
    with pytest.raises(FeedbackError, match="sends no data packages"):
        driver.enable()
    with pytest.raises(SpentLinkError, match="sends no data packages"):
        robot.driver()


# A link that is lost


def test_closed_connection_is_a_lost_link_and_nothing_is_called_again(robot):
    driver, start = enabled(robot)
    robot.is_connected = False
    with pytest.raises(SpentLinkError, match="closed the connection"):
        cycle(driver)
    robot.is_connected = True
    with pytest.raises(SpentLinkError, match="was lost"):
        driver.write(Setpoint(0, start.q, position=start.position))
    driver.disable()
    driver.close()
    assert not robot.calls


def test_either_connection_that_is_closed_is_a_lost_link(robot):
    driver, _ = enabled(robot)
    robot.is_control_connected = False
    with pytest.raises(SpentLinkError, match="closed the connection"):
        cycle(driver)


def test_link_that_goes_while_it_is_closed_is_not_touched_again(robot):
    driver, _ = enabled(robot)
    robot.answers["stopScript"] = RuntimeError("gone")
    driver.close()
    driver.close()
    assert [name for name, _ in robot.calls] == ["stopScript"]


def test_library_that_cannot_connect_anew_says_so_once(robot):
    driver, start = enabled(robot)
    robot.answers["servoL"] = RuntimeError("Timeout connecting\nto UR dashboard server.")
    with pytest.raises(SpentLinkError, match="Timeout connecting to UR dashboard server"):
        driver.write(Setpoint(0, start.q, position=start.position))
    driver.close()
    assert [name for name, _ in robot.calls] == ["servoL"]


def test_library_that_connected_anew_is_found_within_a_second(robot, monkeypatch):
    driver, _ = enabled(robot)
    cycle(driver)
    monkeypatch.setattr("orientd_ur.link.are_open", lambda _: False)
    for _ in range(500):
        cycle(driver)
    with pytest.raises(SpentLinkError, match="the library made another"):
        cycle(driver)
    driver.disable()
    driver.close()
    assert not robot.calls


def test_slow_call_is_looked_into_at_once(robot, monkeypatch):
    driver, start = enabled(robot)
    monkeypatch.setattr("orientd_ur.link.are_open", lambda _: False)
    driver.write(Setpoint(0, start.q, position=start.position))
    robot.answers["servoL"] = lambda: driver.clock.advance(21 * MS) or True
    with pytest.raises(SpentLinkError, match="the library made another"):
        driver.write(Setpoint(0, start.q, position=start.position))


# A program that does not follow


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ([7, 3, 4], "protective stop"),
        ([7, 1, 4], "paused on the pendant"),
        ([7, 1, 1], "was stopped; reset to start it again"),
        ([5, 1, 2], r"robot mode: idle"),
    ],
)
def test_robot_that_does_not_follow_is_a_fault_in_words(robot, modes, words):
    driver, start = enabled(robot)
    cycle(driver)
    robot.modes = modes
    with pytest.raises(DeviceFaultError, match=words):
        cycle(driver)
    robot.answers["servoL"] = False
    with pytest.raises(DeviceFaultError, match=words):
        driver.write(Setpoint(0, start.q, position=start.position))


def test_setpoint_that_is_not_taken_is_a_fault_even_if_nothing_explains_it(robot):
    driver, start = enabled(robot)
    robot.answers["servoL"] = False
    with pytest.raises(DeviceFaultError, match="takes no setpoints"):
        driver.write(Setpoint(0, start.q, position=start.position))


def test_state_that_explains_a_refused_setpoint_is_waited_for(robot):
    driver, start = enabled(robot)

    def refused_before_it_is_said():
        monkey = iter([2, 2, 4])
        driver._link.modes = lambda: (7, 1, next(monkey, 4))
        return False

    robot.answers["servoL"] = refused_before_it_is_said
    with pytest.raises(DeviceFaultError, match="paused"):
        driver.write(Setpoint(0, start.q, position=start.position))


def test_program_that_its_watchdog_ended_is_said_to_be_ended_by_it(robot):
    driver, start = enabled(robot, watchdog_hz=10)
    driver.write(Setpoint(0, start.q, position=start.position))
    driver.clock.advance(150 * MS)
    robot.modes[2] = int(RuntimeState.STOPPED)
    with pytest.raises(DeviceFaultError, match="nothing was written for 152 ms, 100 ms are"):
        cycle(driver)


# Standing by


def test_watchdog_is_kept_quiet_while_nothing_is_sent(robot):
    driver = robot.driver(watchdog_hz=10)
    for _ in range(100):
        cycle(driver)
    assert not robot.called("kickWatchdog")
    driver.enable()
    driver.disable()
    robot.calls.clear()
    for _ in range(100):
        cycle(driver)
    # Five times as often as it has to hear.
    assert len(robot.called("kickWatchdog")) in (9, 10)
    robot.modes[2] = int(RuntimeState.PAUSED)
    robot.calls.clear()
    for _ in range(100):
        cycle(driver)
    assert not robot.calls


def test_arm_is_stopped_when_it_is_disabled_and_only_then(robot):
    driver, _ = enabled(robot, stop_deceleration=7)
    driver.clock.advance(1000 * MS)
    driver.disable()
    driver.disable()
    # The order has fed the watchdog, too.
    cycle(driver)
    assert robot.calls == [("servoStop", (7.0,))]


@pytest.mark.parametrize("modes", [[7, 3, 2], [7, 1, 4], [3, 1, 2]])
def test_robot_that_takes_no_orders_is_given_none_when_it_is_disabled(robot, modes):
    driver, _ = enabled(robot)
    robot.modes = modes
    driver.disable()
    assert not robot.calls


def test_frozen_controller_is_not_waited_for_when_it_is_disabled_or_closed(robot):
    driver, _ = enabled(robot, feedback_timeout=0.1, link_timeout=2.0)
    cycle(driver)
    robot.is_frozen = True
    driver.clock.advance(150 * MS)
    driver.disable()
    driver.close()
    assert not robot.calls


def test_program_ends_with_the_driver(robot):
    driver, _ = enabled(robot)
    driver.close()
    assert [name for name, _ in robot.calls] == [
        "stopScript", "disconnect", "receive.disconnect"
    ]  # fmt: skip


def test_freedrive_is_switched_on_and_off_again(robot):
    driver = robot.driver()
    driver.free()
    assert robot.called("teachMode") == [()]
    assert not robot.called("endTeachMode")
    driver.disable()
    assert robot.called("endTeachMode") == [()]
    robot.calls.clear()
    driver.enable()
    assert not robot.called("endTeachMode")


# Joints that do not follow


def away(robot, angle, *, joint=5):
    """Hold a joint away from where the controller commands it to be."""
    robot.joints[joint] = robot.target_joints[joint] + angle


def following(driver, *, ms=300):
    """Run cycles in which the joints may be away."""
    for _ in range(ms // 2):
        cycle(driver)


@pytest.mark.parametrize("angle", [0.1, -0.1])
def test_joint_that_stays_away_from_its_command_is_a_fault_once(robot, angle):
    driver, _ = enabled(robot)
    away(robot, angle)
    following(driver, ms=98)
    words = r"^joint wrist 3 does not follow: it is 5\.7 deg behind for more than 0\.1 s"
    with pytest.raises(AxisFaultError, match=words):
        following(driver)
    # The stop has feedback.
    robot.joints[5] += 0.01
    assert cycle(driver).joints[5] == pytest.approx(robot.joints[5])
    following(driver)


def test_joints_that_stay_away_are_all_named(robot):
    driver, _ = enabled(robot)
    away(robot, 0.1)
    away(robot, 0.2, joint=0)
    with pytest.raises(AxisFaultError, match=r"joint base .* 11\.5 deg .*; joint wrist 3"):
        following(driver)


def test_joint_may_be_as_far_away_as_the_option_says(robot):
    driver, _ = enabled(robot, follow_tolerance_deg=20)
    away(robot, 0.34)
    following(driver)
    away(robot, 0.36)
    with pytest.raises(AxisFaultError):
        following(driver)


def test_arm_that_is_guided_by_hand_or_disabled_is_not_judged(robot):
    driver, _ = enabled(robot)
    driver.disable()
    away(robot, 0.5)
    following(driver)
    driver.free()
    following(driver)
    away(robot, 0.0)
    driver.enable()
    following(driver)
    driver.rest_in_fault()
    away(robot, 0.5)
    following(driver)


def test_arm_is_judged_again_once_it_is_enabled_again(robot):
    driver, _ = enabled(robot)
    for _ in range(2):
        away(robot, 0.2)
        with pytest.raises(AxisFaultError):
            following(driver)
        away(robot, 0.0)
        driver.disable()
        driver.enable()


def test_arm_is_commanded_to_be_where_it_is_before_a_fault_ends_the_program(robot):
    driver, _ = enabled(robot, lookahead=0.05, gain=500)
    away(robot, -0.1)
    before = list(robot.target_joints)
    driver.rest_in_fault()
    while not robot.called("stopScript"):
        cycle(driver)
        if goals := robot.called("servoJ"):
            robot.target_joints = list(goals[-1][0])
    steps = robot.called("servoJ")
    assert {tuple(how) for _, *how in steps} == {(0.0, 0.0, 0.002, 0.05, 500.0)}
    wrist = [before[5], *(goal[5] for goal, *_ in steps)]
    assert max(abs(a - b) for a, b in pairwise(wrist)) == pytest.approx(0.002)
    assert wrist[-1] == pytest.approx(robot.joints[5], abs=math.radians(0.5))
    assert all(goal[:5] == before[:5] for goal, *_ in steps)
    assert [name for name, _ in robot.calls[len(steps) :]] == ["servoStop", "stopScript"]


def test_program_ends_in_a_fault_although_the_command_does_not_come_back(robot):
    driver, _ = enabled(robot)
    away(robot, 0.3)
    driver.rest_in_fault()
    following(driver, ms=4_900)
    assert not robot.called("stopScript")
    following(driver, ms=200)
    assert robot.called("stopScript")


@pytest.mark.parametrize("modes", [[7, 3, 2], [7, 1, 4], [7, 1, 1], [5, 1, 2]])
def test_robot_that_is_stopped_is_not_commanded_back_in_a_fault(robot, modes):
    driver, _ = enabled(robot)
    away(robot, 0.3)
    robot.modes = modes
    driver.rest_in_fault()
    following(driver)
    robot.modes = [7, 1, 2]
    following(driver)
    assert not robot.called("servoJ")


def test_arm_that_was_cut_off_is_not_commanded_back(robot):
    driver, _ = enabled(robot)
    away(robot, 0.3)
    driver.rest_in_fault()
    driver.disable()
    following(driver)
    assert not robot.called("servoJ")
    assert robot.called("stopScript")


# Faults and the way out of them


def test_stream_is_taken_back_in_a_fault(robot):
    driver, start = enabled(robot, stop_deceleration=7)
    driver.rest_in_fault()
    driver.write(Setpoint(0, start.q, position=start.position))
    cycle(driver)
    assert robot.calls == [("servoStop", (7.0,)), ("stopScript", ())]
    assert not driver.notices()
    robot.modes[2] = int(RuntimeState.STOPPED)
    cycle(driver)
    robot.modes[2] = int(RuntimeState.PLAYING)
    cycle(driver)
    cycle(driver)
    assert driver.notices() == ("another program was played on the robot during the fault",)
    assert robot.calls[2:] == [("kickWatchdog", ())]


def test_program_that_is_played_on_in_a_fault_is_ended_with_a_notice(robot):
    driver, _ = enabled(robot)
    robot.dashboard_answers["stop"] = "Failed to execute: stop"
    robot.modes[2] = int(RuntimeState.PAUSED)
    driver.rest_in_fault()
    for _ in range(3):
        cycle(driver)
    robot.modes[2] = int(RuntimeState.PLAYING)
    cycle(driver)
    assert [name for name, _ in robot.calls] == ["kickWatchdog", "servoStop", "stopScript"]
    (notice,) = driver.notices()
    assert notice == "the control program was played on the robot during the fault; it was ended"


def test_paused_program_is_ended_at_the_dashboard_twice_a_second_until_it_is(robot):
    driver, _ = enabled(robot)
    robot.dashboard_answers["stop"] = "Failed to execute: stop"
    robot.modes[2] = int(RuntimeState.PAUSED)
    driver.rest_in_fault()
    for _ in range(13):
        cycle(driver, ms=100)
        driver._program._asking.join()
    assert robot.dashboard == ["stop"] * 3
    robot.dashboard_answers["stop"] = "Stopped"
    for _ in range(12):
        cycle(driver, ms=100)
        driver._program._asking.join()
    assert robot.dashboard == ["stop"] * 4
    driver.rest_in_fault()
    assert robot.dashboard == ["stop"] * 4
    robot.modes[2] = int(RuntimeState.PLAYING)
    cycle(driver)
    assert driver.notices() == ("another program was played on the robot during the fault",)
    assert not robot.called("stopScript")


@pytest.mark.parametrize("state", [RuntimeState.STOPPED, RuntimeState.PAUSED])
def test_last_setpoint_leaves_the_registers_once_in_a_fault(robot, state):
    driver, start = enabled(robot)
    driver.write(Setpoint(0, start.q, position=start.position))
    robot.modes[2] = int(state)
    driver.rest_in_fault()
    assert robot.command == 24
    for _ in range(3):
        cycle(driver)
    assert robot.command == 0
    assert robot.called("kickWatchdog") == [()]


def test_program_is_uploaded_only_once_the_controller_holds_no_command(robot, monkeypatch):
    driver, start = enabled(robot)
    driver.write(Setpoint(0, start.q, position=start.position))
    robot.modes[2] = int(RuntimeState.STOPPED)
    held = []

    def play():
        held.append(robot.command)
        robot.modes[2] = int(RuntimeState.PLAYING)
        return True

    robot.answers["reuploadScript"] = play
    driver.reset()
    assert not any(held)
    robot.modes[2] = int(RuntimeState.STOPPED)
    robot.calls.clear()
    monkeypatch.setattr("orientd_ur.link._CLEARED", 0.02)
    robot.answers["kickWatchdog"] = lambda: setattr(robot, "command", 24)
    with pytest.raises(DeviceFaultError, match="holds the command 24 in input_int_register_0"):
        driver.reset()
    assert not robot.called("reuploadScript")


def test_every_fault_ends_the_program_anew(robot):
    driver, _ = enabled(robot)
    robot.answers["stopScript"] = lambda: robot.modes.__setitem__(2, 1) or True
    robot.answers["reuploadScript"] = lambda: robot.modes.__setitem__(2, 2) or True
    robot.dashboard_answers["stop"] = lambda: robot.modes.__setitem__(2, 1) or "Stopped"
    for count in (1, 2):
        driver.rest_in_fault()
        for _ in range(3):
            cycle(driver)
        assert len(robot.called("stopScript")) == count
        assert not driver.notices()
        driver.reset()
        cycle(driver)
        assert len(robot.called("stopScript")) == count
        driver.enable()


def test_reset_unlocks_powers_up_and_plays_anew(robot):
    driver, _ = enabled(robot)
    robot.modes = [3, 3, int(RuntimeState.PAUSED)]
    ready = iter(["too early", lambda: robot.modes.__setitem__(1, 1) or "releasing"])

    def unlock():
        answer = next(ready)
        return answer() if callable(answer) else answer

    robot.dashboard_answers.update({
        "unlock protective stop": unlock,
        "brake release": lambda: robot.modes.__setitem__(0, 7) or robot.late.update(mode=3),
        "stop": lambda: robot.modes.__setitem__(2, 1) or "Stopped",
    })  # fmt: skip
    robot.answers["reuploadScript"] = lambda: robot.modes.__setitem__(2, 2) or True
    driver.rest_in_fault()
    driver.reset()
    assert robot.dashboard == [
        "unlock protective stop", "unlock protective stop", "close safety popup", "power on",
        "brake release", "stop",
    ]  # fmt: skip
    assert robot.called("reuploadScript") == [()]
    driver.enable()
    cycle(driver)


def test_reset_powers_up_only_if_it_may_and_if_it_has_to(robot):
    driver, _ = enabled(robot, release_brakes=False)
    robot.dashboard_answers["stop"] = lambda: robot.modes.__setitem__(2, 1) or "Stopped"
    robot.answers["reuploadScript"] = lambda: robot.modes.__setitem__(2, 2) or True
    driver.reset()
    assert robot.dashboard == ["stop"]
    robot.modes[0] = 3
    with pytest.raises(DeviceFaultError, match="power off"):
        driver.reset()
    assert "power on" not in robot.dashboard


def test_protective_stop_that_stays_locked_is_said_with_the_answer(robot):
    driver, _ = enabled(robot)
    robot.modes[1] = 3
    robot.dashboard_answers["unlock protective stop"] = "Cannot unlock until 5s after"
    with pytest.raises(DeviceFaultError, match="stays locked: Cannot unlock until 5s after"):
        driver.reset()


def test_local_control_is_refused_if_the_software_says_it(robot, monkeypatch):
    robot.dashboard_answers["is in remote control"] = False
    for call in ("enable", "reset"):
        with pytest.raises(DeviceFaultError, match="is in local control"):
            getattr(robot.driver(), call)()
    robot.driver(check_remote_control=False).enable()
    FakeRobot.install(robot, monkeypatch, version=(5, 5, 0, 0)).driver().enable()


def test_reset_that_cannot_play_says_so(robot, monkeypatch):
    driver, _ = enabled(robot)
    robot.modes[2] = int(RuntimeState.STOPPED)
    play = driver._link.play
    driver._link.play = lambda: play(0.02)
    with pytest.raises(DeviceFaultError, match="does not play the control program; is it in"):
        driver.reset()


def test_polyscope_x_is_asked_nothing_at_a_dashboard(robot, monkeypatch):
    robot.install(monkeypatch, version=(10, 11, 0, 0))
    driver, _ = enabled(robot)
    assert "PolyScope X has no dashboard server" in driver.notices()[0]
    robot.modes[2] = int(RuntimeState.PAUSED)
    driver.rest_in_fault()
    cycle(driver)
    robot.answers["reuploadScript"] = lambda: robot.modes.__setitem__(2, 2) or True
    driver.reset()
    assert not robot.dashboard
    robot.refusals = ["Failed to start control script, before timeout of 5 seconds"]
    with pytest.raises(DeviceFaultError, match=r"does not play the control program: PolyScope X"):
        robot.driver().enable()


def test_frozen_controller_is_not_waited_for_in_a_fault(robot):
    driver, _ = enabled(robot, feedback_timeout=0.1, link_timeout=2.0)
    cycle(driver)
    driver.rest_in_fault()
    robot.is_frozen = True
    for _ in range(2):
        cycle(driver, ms=80)
    assert len(robot.called("stopScript")) == 1


# Taking control


def test_registers_that_are_given_back_late_are_asked_for_again(robot, monkeypatch):
    monkeypatch.setattr("orientd_ur.link.time.sleep", lambda _: None)
    robot.refusals = ["one of the registers is already in use"] * 9
    robot.driver().enable()
    assert len(robot.called("control")) == 10


@pytest.mark.parametrize(
    ("registers", "flags", "other"), [("lower", 1, "upper"), ("upper", 9, "lower")]
)
def test_registers_of_another_client_are_named_with_the_way_out(
    robot, monkeypatch, registers, flags, other
):
    monkeypatch.setattr("orientd_ur.link.time.sleep", lambda _: None)
    robot.refusals = ["one of the registers is already IN USE"] * 10
    words = rf"holds the {registers} registers .* set the option `registers` to {other}"
    with pytest.raises(LinkError, match=words):
        robot.driver(registers=registers).enable()
    assert robot.called("control") == [(HOST, -1.0, flags)] * 10


def test_other_refusals_are_given_as_they_are(robot):
    robot.refusals = ["a b\n c"]
    with pytest.raises(DeviceFaultError, match=r"127\.0\.0\.9: a b c"):
        robot.driver().enable()


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ((5, 3, 0, 0), "5.4 or newer is needed"),
        ((3, 15, 0, 0), "`rate_hz` must be 125 at the most"),
    ],
)
def test_robot_that_cannot_be_driven_is_not_connected_to(robot, monkeypatch, version, words):
    robot.install(monkeypatch, version=version)
    with pytest.raises(LinkError, match=words):
        robot.driver()
    assert not robot.calls


# Arrival


def test_gaps_are_of_the_tool_and_of_each_joint_behind_its_command(robot):
    driver, start = enabled(robot, arrival_tolerance_deg=1.0)
    driver.write(Setpoint(0, start.q, position=(0.1, 0.2, 0.35)))
    robot.joints = [q + 0.01 * k for k, q in enumerate(JOINTS)]
    cycle(driver)
    tool, *joints = driver.gaps()
    assert (tool.gap, tool.patience) == (pytest.approx(0.05), 0.5)
    assert tool.tolerance == pytest.approx(math.radians(1.0))
    assert [one.gap for one in joints] == pytest.approx([-0.01 * k for k in range(6)])
    assert joints[0].name == "joint base"
    driver.write(Setpoint(0, multiply(start.q, exp((0.2, 0.0, 0.0))), position=start.position))
    assert driver.gaps()[0].gap == pytest.approx(0.2)


def test_patience_is_longer_the_more_the_controller_smooths_and_the_slower_it_runs(robot):
    driver, _ = enabled(robot, lookahead=0.2)
    assert {one.patience for one in driver.gaps()} == {1.0}
    robot.scaling = 0.1
    cycle(driver)
    assert driver.gaps()[0].patience == pytest.approx(10.0)


def test_end_of_the_process_is_explained_by_its_signal(robot):
    driver = robot.driver()
    assert f"see what the controller at {HOST} sends" in driver.why_ended(6)
    assert "took more than 0.9 s" in driver.why_ended(14)
    assert f"when the controller at {HOST} closes a connection" in driver.why_ended(11)
    assert (driver.default_rate_hz, driver.longest_call) == (500.0, 0.9)
    assert driver.why_ended(9) == ""
    assert driver.why_stale() == ""
    assert driver.deadline_shift_ns(0) == 0


def listening(robot, *, heard=None, silence_ms=None):
    driver, _ = enabled(robot, feedback_timeout=0.1)
    silence = None if silence_ms is None else silence_ms * MS
    driver._listener = SimpleNamespace(heard=lambda: heard, silence_ns=lambda: silence)
    return driver


def test_deadlines_move_towards_a_quarter_of_a_cycle_behind_the_data(robot):
    now = 10**12
    assert listening(robot).deadline_shift_ns(now) == 0
    # A sixteenth of what is missing, by the shorter way round.
    assert listening(robot, heard=(100.0, now)).deadline_shift_ns(now) == 500_000 // 16
    late = listening(robot, heard=(100.0, now))
    assert late.deadline_shift_ns(now + 700_000) == -200_000 // 16


@pytest.mark.parametrize(
    ("silence_ms", "words"),
    [
        (None, "feedback from 127.0.0.9 for 0.180 s"),
        (59, "arrived 59 ms ago, so this machine was too busy to take it in"),
        (61, "arrived 61 ms ago, so the controller or the network is late"),
    ],
)
def test_missing_feedback_is_said_to_be_late_by_whose_fault(robot, silence_ms, words):
    driver = listening(robot, silence_ms=silence_ms)
    cycle(driver)
    robot.is_frozen = True
    for _ in range(2):
        driver.clock.advance(45 * MS)
        driver.read()
    with pytest.raises(FeedbackError, match=words):
        cycle(driver, ms=90)


def test_servo_looks_ahead_with_the_calibrated_arm_and_the_tool_as_it_is_seen(robot, monkeypatch):
    links = MODELS["ur5e"].links
    own = links.table._replace(theta=(1e-3,) * 6)
    calibrated = replace(MODELS["ur5e"].arm(), kinematics=Kinematics(links, own))
    monkeypatch.setattr("orientd_ur.robot.ask", lambda *_: calibrated)
    driver, start = enabled(robot)
    arm = driver.mechanism(may_ask=False)
    assert arm.kinematics is calibrated.kinematics
    assert arm.forward(JOINTS)[1] == pytest.approx(start.position)


def test_link_that_is_lost_while_the_program_is_awaited_is_said_to_be_lost(robot):
    driver, _ = enabled(robot)
    driver.disable()
    robot.modes[2] = int(RuntimeState.STOPPED)
    robot.answers["reuploadScript"] = lambda: setattr(robot, "is_connected", False)
    with pytest.raises(SpentLinkError, match="closed the connection"):
        driver.enable()


def test_offline_plan_begins_where_the_robot_or_the_options_say(robot, monkeypatch):
    arm = MODELS["ur5e"].arm()
    pose = arm.forward(JOINTS)
    place = Place(JOINTS, pose, None)
    monkeypatch.setattr("orientd_ur.robot.whereabouts", lambda *_, **__: place)
    driver = robot.driver(model="ur5e", start_joints=[0.0, -1.0, 1.0, -1.0, -1.0, 0.0])
    start = driver.offline_start(from_device=True)
    assert (start.q, start.position, start.joints) == (*pose, JOINTS)
    start = driver.offline_start(from_device=False)
    assert start.joints == (0.0, -1.0, 1.0, -1.0, -1.0, 0.0)
    assert (start.q, start.position) == arm.forward(start.joints)
