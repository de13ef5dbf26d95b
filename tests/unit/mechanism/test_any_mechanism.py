"""Whatever has axes is planned for in the same way: a wrist that reaches one place only."""

import math
import re

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from orientd.driver import AxisLimits, Driver
from orientd.errors import LimitError, LimitKind, LinkError, PlanError, RequestError, StartError
from orientd.mechanism import Gimbal, Mechanism, Reserve
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.measuring import STATE, AxisRecords, measure
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import exp, multiply
from orientd.tolerances import GUARD_TOLERANCE

PERIOD = 0.004
LIMITS = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)
BENT = (0.2, 0.3, -0.1)


class Wrist(Mechanism):
    """Three axes, in no way a gimbal to the planner; the tool is 0.1 m away from their centre."""

    def __init__(self, velocity=3.0, acceleration=40.0, jerk=math.inf, reach=3.0, least=0.02):
        self.axes = tuple(
            AxisLimits(name, -reach, reach, velocity, acceleration, jerk) for name in "abc"
        )
        self._gimbal = Gimbal(self.axes)
        self._least = least

    def forward(self, joints):
        return self._gimbal.orientation(joints), (0.1, 0.0, 0.0)

    def solutions(self, q, position):
        return self._gimbal.solutions(q) if math.dist(position, (0.1, 0.0, 0.0)) < 1e-9 else []

    def reserve(self, joints):
        bend = abs(math.cos(joints[1]))
        return [Reserve("wrist", bend, self._least, 0.1, "rad", "turn about another axis")]


class WristDriver(Driver):
    name = "wrist"

    def __init__(self, wrist):
        super().__init__({}, period_ns=4_000_000, clock=ManualClock(1))
        self.wrist, self.asked = wrist, []

    def mechanism(self, *, may_ask):
        self.asked.append(may_ask)
        if self.wrist is None:
            raise LinkError("nobody answers")
        return self.wrist

    def open(self): ...
    def enable(self): ...
    def read(self): ...
    def write(self, setpoint): ...
    def disable(self): ...
    def close(self): ...


def planned(
    wrist, *turns, begin=BENT, joints=None, move=(0, 0, 0), times=None, offline=False, **fields
):  # fmt: skip
    """Plan from *begin* through orientations turned by vectors from there."""
    q, position = Gimbal(WRIST.axes).orientation(begin), (0.1, 0.0, 0.0)
    planner = DevicePlanner(WristDriver(wrist), limits=LIMITS, period=PERIOD)
    keyframes = [
        Keyframe(
            tuple(multiply(np.array(q), exp(np.array(turn))).tolist()),
            None if times is None else times[k],
            position=tuple(np.add(position, np.multiply(move, k > 0))),
        )
        for k, turn in enumerate([(0.0, 0.0, 0.0), *turns])
    ]
    return planner.plan(
        MotionRequest(keyframes, **fields), start=State.at_rest(q, position),
        joints=begin if joints is None else joints, is_offline=offline,
    )  # fmt: skip


WRIST = Wrist()


def largest(motion, order):
    return np.abs(np.diff(motion.path.joints, order, axis=0)).max() / PERIOD**order


def figures(motion):
    return {one.name: one for one in motion.certificate.figures}


def test_joints_make_every_pose_and_are_certified():
    motion = planned(WRIST, (0.5, 0.2, 0.4))
    for record in range(0, motion.record_count, 7):
        q, _ = WRIST.forward(motion.recorded().joints_at(record))
        assert abs(np.dot(q, motion.path.table[record, :4])) == pytest.approx(1.0, abs=1e-12)
    assert motion.first_joints == pytest.approx(BENT, abs=1e-9)
    found = figures(motion)
    assert found["velocity of a"].limit == 3.0
    assert found["acceleration of b"].value <= 40.0
    assert found["largest angle of c"].limit == 3.0
    assert any(note.startswith("a: ") for note in motion.certificate.notes)


@pytest.mark.parametrize(
    ("limits", "kind"), [({"velocity": 1.0}, 1), ({"acceleration": 6.0}, 2), ({"jerk": 60.0}, 3)]
)
def test_motion_is_as_slow_as_an_axis_needs_it(limits, kind):
    free, slow = planned(WRIST, (0.5, 0.2, 0.9)), planned(Wrist(**limits), (0.5, 0.2, 0.9))
    (most,) = limits.values()
    assert largest(free, kind) > 1.1 * most
    assert 0.85 * most < largest(slow, kind) <= 1.001 * most
    assert slow.duration > free.duration


def test_times_of_the_user_are_kept_or_refused_with_the_axis_and_a_duration_that_would_do():
    turn, begin = (0.9, 0.0, 0.0), (0.2, 0.0, 0.0)
    motion = planned(WRIST, turn, begin=begin, times=(0.0, 1.5), approach=True)
    assert motion.end_time - motion.start_time == pytest.approx(1.5)
    with pytest.raises(LimitError, match=r"velocity of c .* s in place of 1.5 s would") as caught:
        planned(Wrist(velocity=0.5), turn, begin=begin, times=(0.0, 1.5), approach=True)
    assert caught.value.kind is LimitKind.VELOCITY


def test_a_stop_counts_the_axes():
    motion = planned(Wrist(acceleration=14.0), (0.5, 0.2, 0.9))
    path = motion.path
    tight, free = (
        measure(
            np.ascontiguousarray(path.table[:, :STATE]),
            motion.record_count,
            motion.period,
            Limits.partial(),
            before=None,
            tolerance=GUARD_TOLERANCE,
            axes=AxisRecords(path.joints, path.joint_rates, path.earlier, Wrist(**one).axes),
        ).brake_rate
        for one in ({"acceleration": 14.0}, {"acceleration": 1000.0})
    )
    assert 0.0 < tight < free
    assert motion.certificate.brake_rate <= tight


def test_an_axis_at_the_end_of_its_range_is_named():
    with pytest.raises(LimitError, match=r"angle of a reaches .* unwind it first") as caught:
        planned(Wrist(reach=1.0), (0.0, 0.0, 0.7), (0.0, 0.0, 1.5), begin=(0.2, 0.0, 0.0))
    assert caught.value.kind is LimitKind.RANGE
    assert caught.value.limit == 1.0


def test_a_singularity_that_is_too_near_is_named_with_what_to_do():
    begin = (0.2, 1.4, 0.0)
    with pytest.raises(PlanError, match=r"the wrist comes within .* turn about another axis"):
        planned(Wrist(least=0.15), (0.0, 0.12, 0.0), begin=begin)


def test_a_pose_out_of_reach_is_named_with_its_place():
    place = re.escape("do not reach the pose between keyframes[0] and keyframes[1]")
    with pytest.raises(PlanError, match=place):
        planned(WRIST, (0.5, 0.2, 0.4), move=(0.2, 0.0, 0.0))


def test_joints_that_are_not_known_are_those_nearest_to_home():
    motion = planned(WRIST, (0.1, 0.2, 0.4), joints=())
    assert motion.first_joints == pytest.approx(BENT, abs=1e-9)
    with pytest.raises(StartError, match="do not reach where the path begins"):
        planned(Wrist(reach=0.1), (0.1, 0.2, 0.4), joints=())


def test_only_a_gimbal_goes_home():
    with pytest.raises(RequestError, match="only a gimbal has a home"):
        planned(WRIST, (0.1, 0.2, 0.4), device_options={"home": True})


def test_a_device_that_does_not_say_what_it_is_refuses_plans():
    with pytest.raises(PlanError, match="cannot predict the axes: nobody answers"):
        planned(None, (0.5, 0.2, 0.4))


@pytest.mark.parametrize("offline", [True, False])
def test_a_device_is_asked_unless_the_plan_is_made_offline(offline):
    driver = WristDriver(WRIST)
    planner = DevicePlanner(driver, limits=LIMITS, period=PERIOD)
    q, position = WRIST.forward(BENT)
    planner.plan(
        MotionRequest([Keyframe(q, position=position), Keyframe((1.0, 0.0, 0.0, 0.0),
                                                                position=position)]),
        start=State.at_rest(q, position), joints=BENT, is_offline=offline,
    )  # fmt: skip
    assert driver.asked == [not offline]


def test_a_retargeted_motion_goes_on_with_the_axes_as_they_move():
    motion = planned(WRIST, (0.5, 0.2, 0.9))
    record = motion.record_count // 2
    planner = DevicePlanner(WristDriver(WRIST), limits=LIMITS, period=PERIOD)
    state = motion.state_at(record)
    goal = tuple(multiply(state.q, exp(np.array([0.0, 0.3, -0.4]))).tolist())
    onward = planner.plan(
        MotionRequest([Keyframe(goal, position=(0.1, 0.0, 0.0))], approach=True), start=state,
        joints=motion.recorded().joints_at(record), before=motion.path.joints_before(record),
    )  # fmt: skip
    axes = np.array([*motion.path.joints_before(record), *onward.path.joints])
    assert np.abs(np.diff(axes, 2, axis=0)).max() / PERIOD**2 <= 40.0 * 1.001
    assert axes[3] == pytest.approx(motion.recorded().joints_at(record), abs=1e-9)
