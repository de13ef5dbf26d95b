"""The joints of a path: between records by the law of Hermite, and what a driver gets of them."""

from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, TERMS, RecordingLoopback, Rig, turn
from scipy.interpolate import CubicHermiteSpline

from orientd.driver import IDENTITY, AxisLimits, Feedback
from orientd.errors import Fault
from orientd.mechanism import Gimbal
from orientd.servo.path.segment import PathPoint, Segment
from orientd.stream.records import JOINTS, Answer, Command, ServoState
from orientd.tolerances import GUARD_TOLERANCE

PATH = turn()
TIMES = PERIOD * np.arange(len(PATH[0]))


class JointLoopback(RecordingLoopback):
    """A device of two axes, which are those of a gimbal off the path only."""

    takes = "joints"
    axes = (AxisLimits("pan", -3.0, 3.0, 4.0, 12.0), AxisLimits("tilt", -3.0, 3.0, 2.0, 6.0))

    def enable(self):
        return super().enable()._replace(joints=(0.0, 0.5))

    def mechanism(self, *, may_ask):
        return Gimbal(self.axes, order="ZY", is_pointing=True)


class JointRig(Rig):
    """A servo on it whose paths have joints."""

    def __init__(self, kind=JointLoopback):
        super().__init__(kind=kind)

    def lay(self, *path, joints=None, **options):
        return super().lay(
            *path, joints=table(len(path[0])) if joints is None else joints, **options
        )


def table(count, axes=2):
    """Return joints that begin at rest at 0 and 0.5 rad, with their velocities."""
    found = np.full((count, 2 * JOINTS), np.nan)
    t = np.minimum(PERIOD * np.arange(count), TIMES[-1]) / TIMES[-1]
    place, speed = t**3 * (10 - 15 * t + 6 * t**2), 30 * t**2 * (1 - t) ** 2 / TIMES[-1]
    for axis, (begin, way) in enumerate([(0.0, 2.0), (0.5, -1.0)][:axes]):
        found[:, axis], found[:, JOINTS + axis] = begin + way * place, way * speed
    return found


def sent(rig):
    return np.array([setpoint.joints for setpoint in rig.driver.setpoints])


def test_between_two_records_the_joints_are_the_cubic_of_their_angles_and_velocities():
    begin = PathPoint(IDENTITY, *[(0.0, 0.0, 0.0)] * 4, (0.1, -2.0, 7.0), (1.0, 0.0, -3.0))
    end = begin._replace(joints=(0.13, -2.0, 6.8), joint_velocities=(0.5, 0.1, 2.0))
    segment = Segment(begin, end, 0.02)
    law = CubicHermiteSpline(
        [0.0, 0.02],
        [begin.joints, end.joints],
        [begin.joint_velocities, end.joint_velocities],
    )
    for u in (0.001, 0.3, 0.5, 0.97):
        assert segment.at(u).joints == pytest.approx(law(0.02 * u), abs=1e-14)
        rates = [one.rate(u) / 0.02 for one in segment.joints]
        assert rates == pytest.approx(law.derivative()(0.02 * u), abs=1e-11)
    assert segment.at(0.0).joints == begin.joints


def test_a_motion_as_planned_sends_the_joints_of_its_records_to_the_last_bit():
    rig = JointRig()
    rig.start(PATH)
    rig.run_until(lambda servo: not servo.is_moving)
    records = table(len(PATH[0]))[:, :2]
    moving = sent(rig)[-len(records) :]
    assert np.array_equal(moving, records)
    assert rig.cycle.sent_joints == tuple(records[-1])


def test_joints_are_held_from_enabling_on_and_after_the_motion():
    rig = JointRig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    rig.run(5)
    assert np.array_equal(sent(rig), [(0.0, 0.5)] * 6)
    first = rig.lay(*PATH)
    rig.ask(Command.START, path_index=first)
    rig.run(300)
    rig.ask(Command.STOP)
    rig.run_until(lambda servo: not servo.is_moving)
    rig.run(3)
    last = sent(rig)[-4:]
    assert np.array_equal(last, [last[0]] * 4)
    # What is held is a place on the path.
    law = CubicHermiteSpline(TIMES, *np.split(table(len(TIMES))[:, [0, 1, 8, 9]], 2, axis=1))
    place = np.interp(last[0, 0], law(TIMES)[:, 0], TIMES)
    assert last[0] == pytest.approx(law(place), abs=1e-6)


def test_joints_of_a_stop_and_another_speed_are_on_the_path_and_as_smooth():
    rig = JointRig()
    rig.start(PATH)
    rig.run(250)
    rig.ask(Command.SPEED, speed=0.37)
    rig.run(150)
    rig.ask(Command.STOP)
    rig.run_until(lambda servo: not servo.is_moving)
    joints = sent(rig)
    assert 0.5 - joints[:, 1] == pytest.approx(0.5 * joints[:, 0], abs=1e-9)
    # The first axis turns by 2 rad for 1.5 rad of the tool, whose limits the stop keeps.
    for order, most in ((2, TERMS.acceleration), (3, TERMS.jerk)):
        reached = np.abs(np.diff(joints[:, 0], order)).max() / PERIOD**order
        assert reached <= 2.0 / 1.5 * most * GUARD_TOLERANCE


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (table(len(TIMES), axes=0), "begins inf rad from the commanded angles"),
        (table(len(TIMES)) + 1e-3, "begins 0.001 rad from the commanded angles"),
    ],
)
def test_a_path_that_begins_at_other_joints_is_refused(joints, words):
    rig = JointRig()
    rig.ask(Command.ENABLE)
    first = rig.lay(*PATH, joints=joints)
    answer, text = rig.ask(Command.START, path_index=first)
    assert answer is Answer.REFUSED
    assert words in text


@pytest.mark.parametrize("off", [0.0, 1e-4])
def test_a_path_of_other_joints_is_not_spliced(off):
    rig = JointRig()
    first = rig.start(PATH)
    rig.run(100)
    rest = [part[300:] for part in PATH]
    second = rig.lay(*rest, joints=table(len(TIMES))[300:] + off)
    answer, text = rig.ask(Command.SPLICE, motion=2, path_index=second, leave=first + 300)
    if off:
        assert answer is Answer.REFUSED
        assert "angle of an axis of the two paths differs by 0.0001 rad" in text
    else:
        rig.run_until(lambda servo: not servo.is_moving)
        assert rig.servo.state is ServoState.HOLDING
        assert np.array_equal(sent(rig)[-len(TIMES) :], table(len(TIMES))[:, :2])


def test_a_driver_of_poses_gets_what_joints_the_path_has():
    rig = Rig()
    rig.start(PATH, joints=table(len(TIMES)))
    rig.run(100)
    assert rig.cycle.sent_joints == pytest.approx(rig.driver.setpoints[-1].joints, abs=0)
    assert Feedback(0, IDENTITY).joints == ()


def bent(at, by):
    """Return the table with the first axis *by* rad off from record *at* on."""
    found = table(len(TIMES))
    found[at:, 0] += by
    return found


@pytest.mark.parametrize(
    ("by", "words"),
    [
        (1e-2, "velocity 6.875 rad/s of pan, the limit is 4 rad/s"),
        (4e-4, "acceleration 100.015 rad/s^2 of pan, the limit is 12 rad/s^2"),
    ],
)
def test_a_step_of_an_axis_beyond_its_limits_ends_in_a_stop_within_them_and_a_fault(by, words):
    rig = JointRig()
    rig.start(PATH, joints=bent(500, by))
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    setpoints = rig.servo.setpoints
    assert setpoints.fault is Fault.LIMIT_GUARD
    assert words in setpoints.fault_text
    for axis, joints in zip(rig.driver.axes, sent(rig).T, strict=True):
        for order, most in ((1, axis.velocity), (2, axis.acceleration)):
            reached = np.abs(np.diff(joints, order)).max() / PERIOD**order
            assert reached <= most * GUARD_TOLERANCE
    assert np.abs(np.diff(sent(rig)[-2:], axis=0)).max() < 1e-9


@pytest.mark.parametrize(("axis", "fault"), [(0, Fault.PATH_STARVED), (1, Fault.LIMIT_GUARD)])
def test_joints_that_are_no_numbers_end_in_a_stop_within_the_limits_of_the_axes(axis, fault):
    rig = JointRig()
    joints = table(len(TIMES))
    joints[500:, [axis, JOINTS + axis]] = np.nan
    if axis:
        joints[500:, axis] = np.inf
    rig.start(PATH, joints=joints)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is fault
    assert np.isfinite(sent(rig)).all()
    for one, row in zip(rig.driver.axes, sent(rig).T, strict=True):
        assert np.abs(np.diff(row, 2)).max() / PERIOD**2 <= one.acceleration * GUARD_TOLERANCE


def test_the_jerk_of_an_axis_is_guarded_where_it_is_limited():
    rig = JointRig()
    limited = rig.driver.axes[0]._replace(jerk=5000.0)
    rig.driver.axes = (limited, rig.driver.axes[1])
    rig.start(PATH, joints=bent(500, 2e-5))
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert "jerk" in rig.servo.setpoints.fault_text
    assert "of pan, the limit is 5000 rad/s^3" in rig.servo.setpoints.fault_text


def test_a_stop_keeps_the_limits_of_axes_that_are_slower_than_the_tool():
    for at in range(100, 900, 100):
        rig = JointRig()
        slow = [axis._replace(acceleration=6.0) for axis in rig.driver.axes]
        rig.driver.axes = tuple(slow)
        # As the certificate says of the path: it leaves a third of the axes' acceleration.
        rig.start(PATH, servo_limits=replace(TERMS, brake_rate=0.5))
        rig.run(at)
        rig.ask(Command.STOP)
        cycles = rig.run_until(lambda servo: not servo.is_moving)
        assert rig.servo.state is ServoState.HOLDING
        reached = np.abs(np.diff(sent(rig), 2, axis=0)).max(axis=0) / PERIOD**2
        assert (reached <= 6.0 * GUARD_TOLERANCE).all()
        # From at most 1.9 rad/s with 6 rad/s^2.
        assert cycles * PERIOD < 0.5


def test_a_halt_off_the_path_keeps_the_limits_of_the_axes():
    rig = JointRig()
    rig.start(PATH)
    rig.run(400)
    rig.ask(Command.HALT)
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.servo.state is ServoState.HOLDING
    for axis, joints in zip(rig.driver.axes, sent(rig).T, strict=True):
        assert np.abs(np.diff(joints, 2)).max() / PERIOD**2 <= axis.acceleration * GUARD_TOLERANCE
    gimbal = rig.driver.mechanism(may_ask=False)
    assert rig.cycle.q == pytest.approx(gimbal.orientation(rig.cycle.sent_joints), abs=1e-12)


@pytest.mark.parametrize("way", ["stop", "stall", "fault"])
def test_at_rest_between_records_the_orientation_is_what_the_joints_make(way):
    rig = JointRig()
    rig.start(PATH)
    rig.run(403)
    if way == "stop":
        rig.ask(Command.STOP)
    elif way == "stall":
        rig.ask(Command.SPEED, speed=0.37)
        rig.run(3)
        rig.ask(Command.STOP)
        rig.run()
        rig.stall(100)
    else:
        rig.ask(Command.SPEED, speed=0.37)
        rig.run(3)
        rig.servo.setpoints.fail(Fault.DEVICE_FAULT, "for a test")
        rig.run()
    rig.run_until(lambda servo: not servo.is_moving)
    gimbal = rig.driver.mechanism(may_ask=False)
    for _ in range(3):
        assert rig.cycle.q == pytest.approx(gimbal.orientation(rig.cycle.sent_joints), abs=1e-15)
        rig.run()


def test_a_halt_off_the_path_asks_nothing_of_the_axes_of_a_driver_of_poses():
    class Arm(JointLoopback):
        takes = RecordingLoopback.takes

    rig = Rig(kind=Arm)
    rig.start(PATH)
    rig.run(400)
    assert rig.ask(Command.HALT)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.servo.state is ServoState.HOLDING


def test_a_driver_that_takes_joints_must_say_which():
    class Mute(JointLoopback):
        def mechanism(self, *, may_ask):
            return None

    rig = Rig(kind=Mute)
    answer, text = rig.ask(Command.ENABLE)
    assert answer is Answer.FAILED
    assert "takes joints, but does not say which" in text


class AimedLoopback(JointLoopback):
    """The same device with a tool that is level while the tilt is 0.5 rad."""

    def mechanism(self, *, may_ask):
        level = (np.cos(0.25), 0.0, -np.sin(0.25), 0.0)
        return Gimbal(self.axes, order="ZY", is_pointing=True, tool=level)


def pan(steps, start=0.0):
    """Return a path that pans by these steps, rad, and its joints."""
    angles = start + np.concatenate([[0.0], np.cumsum(steps)])
    q = np.zeros((len(angles), 4))
    q[:, 0], q[:, 3] = np.cos(0.5 * angles), np.sin(0.5 * angles)
    still = np.zeros((len(angles), 3))
    joints = np.full((len(angles), 2 * JOINTS), np.nan)
    joints[:, 0], joints[:, 1] = angles, 0.5
    joints[:, JOINTS], joints[:, JOINTS + 1] = np.gradient(angles) / PERIOD, 0.0
    return (q, still, still), joints


def test_a_motion_begins_where_the_last_setpoint_of_the_one_before_it_was():
    # The steps at the ends are as large as the limit of the acceleration allows.
    step = 0.6 * TERMS.acceleration * PERIOD**2
    rig = JointRig(AimedLoopback)
    path, joints = pan([step] * 50)
    rig.start(path, joints=joints)
    rig.run_until(lambda servo: not servo.is_moving)
    rig.run(5)
    assert rig.cycle.state is ServoState.HOLDING
    path, joints = pan([-step] + [-2.0 * step] * 20 + [-step], 50 * step)
    first = rig.lay(*path, joints=joints)
    assert rig.ask(Command.START, path_index=first)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.fault == Fault.NONE
    assert rig.cycle.sent_joints == pytest.approx(joints[-1, :2])


def test_a_mechanism_that_raises_in_motion_ends_in_a_fault_and_not_in_motion():
    class Failing(Gimbal):
        fails = False

        def forward(self, joints):
            if self.fails:
                raise KeyError("tried")
            return super().forward(joints)

    class Device(JointLoopback):
        made = Failing(JointLoopback.axes, order="ZY", is_pointing=True)

        def mechanism(self, *, may_ask):
            return self.made

    rig = JointRig(Device)
    rig.start(PATH)
    rig.run(400)
    Device.made.fails = True
    rig.ask(Command.HALT)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is Fault.INTERNAL
    written = len(rig.driver.setpoints)
    rig.run(20)
    assert len(rig.driver.setpoints) == written
