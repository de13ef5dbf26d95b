"""The axes of a mechanism in the timing: as one more rate beside those of the tool."""

import math
import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from planned import LIMITS, PERIOD, vector

from orientd.driver import AxisLimits
from orientd.errors import LimitError, PlanError
from orientd.keep_out import KeepOut
from orientd.mechanism import Gimbal, Mechanism
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.connect.leads import straight
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.fitting import Fitting
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.axes import SHARE, Axes
from orientd.planner.timing.profiles import quickest
from orientd.rotation import angle, exp, log, multiply, rotate
from orientd_ur.arm import MODELS

FREE = Limits(50.0, 5e3, 1e7, 10.0, 1e3)
HOME = np.array([0.0, -1.6, 1.6, -1.6, -1.6, 0.0])
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Arm:
    """Plans for an arm, as its device does."""

    mechanism: Mechanism
    joints: tuple[float, ...]
    limits: Limits = LIMITS["arm"]
    start: State | None = None
    before: tuple = ()
    rates: tuple = ()

    def plan(self, request):
        q, position = self.mechanism.forward(self.joints)
        return plan(
            request,
            start=self.start or State.at_rest(np.array(q), np.array(position)),
            limits=self.limits,
            period=PERIOD,
            axes=Axes(self.mechanism, self.joints, self.before, self.rates),
        )


class Turntable(Mechanism):
    """One axis: its angle is a function of the turn of the tool about z."""

    def __init__(self, velocity, acceleration, jerk, angle):
        self.axes = (AxisLimits("table", -99.0, 99.0, velocity, acceleration, jerk),)
        self.angle = angle

    def forward(self, joints):
        return tuple(exp(np.array([0.0, 0.0, joints[0]])).tolist()), (0.0, 0.0, 0.0)

    def solutions(self, q, position):
        return [self.nearest(q, position, (0.0,))]

    def nearest(self, q, position, near):
        return (self.angle(float(log(np.array(q))[2])),)


def turned(mechanism, turn=2.0, limits=FREE):
    """Return a turn about z, timed for the axes of a mechanism."""
    end = State.at_rest(exp(np.array([0.0, 0.0, turn])))
    path = straight(State.at_rest(IDENTITY), end)
    axes = Axes(mechanism, (mechanism.angle(0.0),)).along(path, (0.0,), limits, PERIOD, 1.0)
    return quickest(path, limits, PERIOD, has_rests=True, axes=axes)


def least(turn, velocity, acceleration, jerk):
    """Return the least duration from rest to rest by phases of constant jerk, s."""
    if math.isinf(jerk):
        peak = min(velocity, math.sqrt(turn * acceleration))
        return turn / peak + peak / acceleration
    low, high = 0.0, velocity
    for _ in range(80):
        peak = 0.5 * (low + high)
        rise = 2.0 * math.sqrt(peak / jerk)
        if peak > acceleration**2 / jerk:
            rise = peak / acceleration + acceleration / jerk
        low, high = (low, peak) if peak * rise > turn else (peak, high)
    return turn / low + rise


@pytest.mark.parametrize("gear", [1.0, -3.0])
@pytest.mark.parametrize(
    "limits",
    [(1.0, 4.0, math.inf), (9.0, 4.0, math.inf), (1.0, 4.0, 30.0), (9.0, 4.0, 30.0), (9, 99, 30)],
)
@pytest.mark.parametrize("tool", [FREE, Limits(1.3, 5.0, 1e5, 1.0, 10.0)], ids=["free", "near"])
def test_a_turn_is_as_fast_as_its_axis_permits(limits, gear, tool):
    table = Turntable(*(abs(gear) * one for one in limits), lambda turn: gear * turn)
    # An axis reaches its acceleration in two periods, or later.
    given = tool.velocity, 0.98 * tool.acceleration, limits[1] / (2.0 * PERIOD)
    best = least(2.0, *map(min, limits, given))
    assert best < turned(table, limits=tool).duration < 1.004 * best


def test_an_axis_that_turns_unevenly_keeps_its_limits_along_all_of_the_turn():
    def angle(turn):
        return turn + 0.4 * math.sin(3.0 * turn)

    quick = turned(Turntable(1.0, 4.0, 60.0, angle))
    times = np.arange(0.0, quick.duration, 1e-3)
    turns = log(quick.trajectory.orientations(times))[:, 2]
    angles = np.array([angle(one) for one in turns])
    rates = [np.abs(np.diff(angles, order)).max() / 1e-3**order for order in (1, 2, 3)]
    assert rates[0] <= 1.0
    assert rates[1] <= 4.0 * 1.001
    assert rates[2] <= 60.0 * 1.02
    # Nearly always some limit is in use.
    used = np.abs(np.diff(angles))[2:] / 1e-3, np.abs(np.diff(angles, 2))[1:] / 1e-3**2 / 4.0
    used = np.maximum(np.maximum(*used), np.abs(np.diff(angles, 3)) / 1e-3**3 / 60.0)
    assert np.mean(used > 0.95) > 0.9


def test_a_tool_that_is_slower_than_the_axes_decides():
    tool = Limits(0.5, 2.0, 20.0, 1.0, 10.0)
    alone, both = (
        turned(Turntable(velocity, 100.0, math.inf, lambda turn: turn), limits=tool).duration
        for velocity in (1e3, 2.0)
    )
    assert both == pytest.approx(alone, rel=1e-3)


def arm_path(random, jerk=math.inf):
    """Return an arm, its joints and a straight path from there."""
    arm = MODELS["ur5e"].arm()
    arm = arm.slower(float(random.uniform(10.0, 40.0)))
    joints = tuple((HOME + random.uniform(-0.5, 0.5, 6)).tolist())
    q, position = (np.array(one) for one in arm.forward(joints))
    end = State.at_rest(
        multiply(q, exp(np.array(vector(random, 0.8)))),
        position + np.array(vector(random, 0.1)),
    )
    return arm, joints, straight(State.at_rest(q, position), end)


def test_the_axes_along_a_path_are_those_of_the_arm_everywhere():
    random = np.random.default_rng(5)
    for _ in range(10):
        arm, joints, path = arm_path(random)
        axes = Axes(arm, joints).along(path, joints, LIMITS["arm"], PERIOD)
        times = random.uniform(0.0, path.duration, 50)
        pieces = axes.pieces.reshape(-1, 6, 6)
        for time in times:
            k = int(np.searchsorted(axes.breaks, time, side="right")) - 1
            u = time - axes.breaks[k]
            q, place = path.trajectory.orientations(np.array([time])), path.positions.sample([time])
            found = np.array(arm.nearest(tuple(q[0]), tuple(place[0][0]), joints))
            assert pieces[k].T @ u ** np.arange(6) == pytest.approx(found, abs=1e-7)
            # Against differences of the arm's own joints.
            step = 1e-4
            if step < time < path.duration - step:
                around = np.array([time - step, time, time + step])
                q, place = path.trajectory.orientations(around), path.positions.sample(around)[0]
                poses = zip(q.tolist(), place.tolist(), strict=True)
                three = np.array([arm.nearest(tuple(a), tuple(b), joints) for a, b in poses])
                powers = np.arange(1, 6)
                rate = pieces[k, 1:].T @ (powers * u ** (powers - 1))
                assert rate == pytest.approx((three[2] - three[0]) / (2 * step), abs=1e-4)
        assert axes.end == pytest.approx(
            arm.nearest(
                tuple(path.trajectory.orientations(np.array([path.duration]))[0]),
                tuple(path.positions.last),
                joints,
            ),
            abs=1e-9,
        )


def test_at_its_own_pace_a_path_takes_longer_by_what_the_worst_axis_needs():
    random = np.random.default_rng(6)
    for _ in range(10):
        arm, joints, path = arm_path(random)
        axes = Axes(arm, joints).along(path, joints, LIMITS["arm"], PERIOD)
        times = np.linspace(0.0, path.duration, 4001)
        poses = zip(
            path.trajectory.orientations(times).tolist(),
            path.positions.sample(times)[0].tolist(),
            strict=True,
        )
        found = np.array([arm.nearest(tuple(q), tuple(place), joints) for q, place in poses])
        step = times[1]
        speed = np.abs(np.diff(found, axis=0)).max(0) / step
        force = np.abs(np.diff(found, 2, axis=0)).max(0) / step**2
        most = [(axis.velocity, axis.acceleration) for axis in arm.axes]
        need = max(
            np.max(speed / [one for one, _ in most]),
            math.sqrt(np.max(force / [SHARE * one for _, one in most])),
        )
        assert axes.excess(PERIOD) == pytest.approx(need, rel=5e-3)


def arm_request(random, jerk=math.inf, **fields):
    """Return the planner of a random arm from rest, and a request for it."""
    arm = MODELS["ur5e"].arm().slower(float(np.exp(random.uniform(np.log(8.0), np.log(40.0)))))
    arm = replace(arm, axes=tuple(one._replace(jerk=jerk) for one in arm.axes))
    joints = tuple((HOME + random.uniform(-0.6, 0.6, 6)).tolist())
    walk, keyframes = np.array(joints), []
    for _ in range(int(random.integers(1, 6))):
        walk = walk + random.normal(0.0, 0.3, 6)
        there = arm.forward(tuple(walk.tolist()))
        keyframes.append(Keyframe(there[0], position=there[1]))
    return Arm(arm, joints), MotionRequest(keyframes, approach=True, **fields)


def rates_of(joints, axes):
    """Return the shares of the limits of all joints, by differences of the records."""
    shares = []
    for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
        limits = np.array([getattr(axis, name) for axis in axes])
        shares.append(np.abs(np.diff(joints, order, axis=0)) / PERIOD**order / limits)
    return shares


@pytest.mark.parametrize("jerk", [math.inf, 400.0])
def test_an_arm_uses_some_limit_nearly_always_and_exceeds_none(jerk):
    random, used = np.random.default_rng(11), []
    for _ in range(25):
        planner, request = arm_request(random, jerk)
        try:
            motion = planner.plan(request)
        except PlanError:
            continue
        speed, force, twist = rates_of(motion.path.joints, planner.mechanism.axes)
        assert speed.max() <= 1.001
        assert force.max() <= 1.001
        assert twist.max() <= 1.001
        samples = motion.sample(PERIOD * np.arange(motion.record_count))
        tool = [
            np.linalg.norm(samples.omega_body, axis=1) / LIMITS["arm"].velocity,
            np.linalg.norm(samples.alpha_body, axis=1) / LIMITS["arm"].acceleration,
            np.linalg.norm(samples.velocity, axis=1) / LIMITS["arm"].linear_velocity,
        ]
        count = len(twist)
        shares = [one.max(1)[-count:] for one in (speed, force, twist)]
        shares += [one[-count:] for one in tool]
        used.append(np.mean(np.max(shares, axis=0) > 0.8))
    assert len(used) > 15
    # At a joint's limit of the jerk the search may stop short of the optimum.
    assert np.median(used) > (0.9 if math.isinf(jerk) else 0.8)


def test_an_even_pace_of_an_arm_stays_even():
    random = np.random.default_rng(3)
    planner, request = arm_request(random, pace="even")
    motion = planner.plan(request)
    slower = replace(planner, mechanism=planner.mechanism.slower(4.0)).plan(request)
    spans = [np.diff(one.keyframe_times) for one in (motion, slower)]
    assert spans[1].sum() > 1.2 * spans[0].sum()
    assert spans[1] / spans[1].sum() == pytest.approx(spans[0] / spans[0].sum(), abs=1e-3)


def test_stops_at_keyframes_are_timed_for_the_axes_too():
    """Back and forth, a curve would swing; with stops the joints still keep their limits."""
    arm = MODELS["ur5e"].arm().slower(10.0)
    joints = tuple(HOME.tolist())
    q = np.array(arm.forward(joints)[0])
    turns = [np.array(one) for one in ((0.9, 0, 0), (0, 0, 0), (0, 0.9, 0), (0, 0, 0))]
    keyframes = [Keyframe(tuple(multiply(q, exp(turn)).tolist())) for turn in turns]
    motion = Arm(arm, joints, LIMITS["quick"]).plan(MotionRequest(keyframes, approach=True))
    speed, force, _ = rates_of(motion.path.joints, arm.axes)
    assert speed.max() <= 1.001
    assert force.max() <= 1.001
    for one, other in pairwise(motion.keyframe_times):
        assert other > one


def test_a_position_alone_moves_along_a_line():
    arm, joints = MODELS["ur5e"].arm().slower(12.0), tuple(HOME.tolist())
    q, position = (np.array(one) for one in arm.forward(joints))
    goal = position + np.array([0.0, 0.12, 0.05])
    request = MotionRequest([Keyframe(tuple(q), position=tuple(goal))], approach=True)
    motion = Arm(arm, joints).plan(request)
    (time,) = motion.keyframe_times
    assert time / PERIOD == pytest.approx(round(time / PERIOD), abs=1e-6)
    samples = motion.sample(np.linspace(0.0, motion.duration, 200))
    way = goal - position
    along = (samples.position - position) @ way / (way @ way)
    assert samples.position == pytest.approx(position + along[:, None] * way, abs=1e-9)
    assert np.diff(along).min() >= -1e-12
    assert samples.position[-1] == pytest.approx(goal, abs=1e-9)


def test_a_path_out_of_reach_of_the_axes_is_refused():
    arm, joints = MODELS["ur5e"].arm(), tuple(HOME.tolist())
    q, position = (np.array(one) for one in arm.forward(joints))
    end = State.at_rest(q, position + np.array([0.0, 0.0, 2.0]))
    path = straight(State.at_rest(q, position), end)
    with pytest.raises(PlanError, match="the axes do not reach the pose"):
        Axes(arm, joints).along(path, joints, LIMITS["arm"], PERIOD)


def test_close_to_a_straight_wrist_the_joints_keep_their_limits_in_one_plan():
    """There the joints turn fastest, and their accelerations change within milliradians."""
    arm = MODELS["ur5e"].arm().slower(15.0)
    joints = (0.3, -1.3, 1.5, -1.7, -0.03, 0.4)
    q = np.array(arm.forward(joints)[0])
    goal = Keyframe(tuple(multiply(q, exp(np.array([0.02, 1.2, 0.02]))).tolist()))
    motion = Arm(arm, joints).plan(MotionRequest([goal], approach=True))
    speed, force, _ = rates_of(motion.path.joints, arm.axes)
    assert 0.89 < max(speed.max(), force.max()) <= 1.001


def test_a_motion_to_where_an_arm_stands_is_planned():
    arm, joints = MODELS["ur5e"].arm(), tuple(HOME.tolist())
    q, position = arm.forward(joints)
    request = MotionRequest([Keyframe(q, position=position)], approach=True)
    motion = Arm(arm, joints).plan(request)
    assert np.ptp(motion.path.joints, axis=0).max() < 1e-9


def test_a_gimbal_away_from_its_poles_uses_some_limit_nearly_always():
    random, used = np.random.default_rng(7), []
    for _ in range(30):
        axes = [
            AxisLimits(name, -9.0, 9.0, random.uniform(1.5, 3.0), random.uniform(8.0, 30.0))
            for name in ("yaw", "pitch", "roll")
        ]
        gimbal = Gimbal(axes, order="ZYX")
        walk = random.uniform(-0.6, 0.6, 3)
        joints, keyframes = tuple(walk.tolist()), []
        for _ in range(int(random.integers(1, 5))):
            walk = np.array([walk[0], 0.0, walk[2]]) + random.uniform(-0.6, 0.6, 3)
            keyframes.append(Keyframe(gimbal.orientation(tuple(walk.tolist()))))
        start = State.at_rest(gimbal.orientation(joints))
        planner = Fitting(gimbal, start, joints, LIMITS["arm"], PERIOD)
        request = MotionRequest(keyframes, approach=True)
        motion = planner.plan(request)
        tool = plan(request, start=start, limits=LIMITS["arm"], period=PERIOD)
        speed, force, _ = rates_of(motion.path.joints, axes)
        assert max(speed.max(), force.max()) <= 1.001
        longer = motion.duration / tool.duration
        assert longer > 0.97
        if longer > 1.05:
            shares = np.maximum(speed[1:].max(1), force.max(1))
            used.append(np.mean(shares > 0.8))
    assert len(used) > 8
    assert np.median(used) > 0.8


def pitched(order, joints, jerk=math.inf):
    """Return a gimbal of equal axes and the planner of a slow tool on it, at rest."""
    names = ("yaw", "pitch", "roll")[: len(order)]
    gimbal = Gimbal([AxisLimits(name, -9.0, 9.0, 3.0, 30.0, jerk) for name in names], order=order)
    start, limits = State.at_rest(gimbal.orientation(joints)), Limits(1.0, 3.0, 40.0, 0.5, 5.0)
    return gimbal, Fitting(gimbal, start, joints, limits, PERIOD)


@pytest.mark.parametrize("pitch", [-1.0, 0.3, 0.8, 1.2])
def test_two_axes_end_with_the_velocity_that_they_make_of_the_requested_one(pitch):
    gimbal, planner = pitched("ZY", (0.0, pitch))
    places = [(0.2, pitch + 0.05), (0.3, pitch + 0.15)]
    keyframes = [Keyframe(gimbal.orientation(one)) for one in places]
    request = MotionRequest(keyframes, approach=True, end_velocity=(0.1, 0.1, -0.15))
    motion = planner.plan(request)
    (omega,) = motion.sample(motion.keyframe_times[-1:]).omega_body
    # Of the pointing axis itself; the axes give the tool a roll of their own.
    assert omega[1:].tolist() == pytest.approx([0.1, -0.15], abs=1e-3)
    assert motion.duration < 2.0


def test_two_axes_rest_rather_than_turn_past_a_pole_evenly_and_end_upside_down():
    gimbal, planner = pitched("ZY", (0.7, -1.227))
    places = [(1.037, -0.779), (1.043, -2.198), (0.058, -2.01)]
    keyframes = [Keyframe(gimbal.orientation(one)) for one in places]
    motion = planner.plan(MotionRequest(keyframes, approach=True, pace="even"))
    assert motion.certificate.keyframe_error < 1e-6
    assert motion.duration < 7.0


@pytest.mark.parametrize("way", [0.02, 0.1, 0.2])
def test_a_lead_in_to_keyframes_with_times_leaves_the_axes_the_jerk_of_their_start(way):
    gimbal, planner = pitched("ZYX", (0.0, 0.8, 0.0), jerk=400.0)
    places = [(way, 0.8 + way, way), (way + 0.2, 0.8, way)]
    keyframes = [Keyframe(gimbal.orientation(one), at) for at, one in enumerate(places)]
    motion = replace(planner, limits=Limits(2.5, 17.0, 8500.0, 1.0, 10.0)).plan(
        MotionRequest(keyframes, approach=True)
    )
    assert np.ptp(motion.keyframe_times) == pytest.approx(1.0)
    assert motion.start_time < 0.5


def test_a_single_keyframe_at_an_even_pace_is_reached_by_a_quintic():
    arm, joints = MODELS["ur5e"].arm(), tuple(HOME.tolist())
    q = arm.forward(joints)[0]
    goal = Keyframe(tuple(multiply(np.array(q), exp(np.array([0.0, 0.4, 0.0]))).tolist()))
    motion = Arm(arm, joints).plan(MotionRequest([goal], approach=True, pace="even"))
    middle = motion.sample(np.array([0.5 * motion.keyframe_times[0]]))
    speed = float(np.linalg.norm(middle.omega_body))
    assert speed == pytest.approx(1.875 * 0.4 / motion.keyframe_times[0], rel=0.02)


def retargets(count, jerk=math.inf):
    """Yield motions of random arms, a record of each, a planner from there on, and a request."""
    random = np.random.default_rng(4)
    while count:
        planner, request = arm_request(random, jerk)
        try:
            motion = planner.plan(request)
        except PlanError:
            continue
        recorded, record = motion.recorded(), int(random.integers(10, motion.record_count - 10))
        joints = recorded.joints_at(record)
        moving = replace(
            planner,
            start=recorded.state_at(record),
            joints=joints,
            before=recorded.joints_before(record),
            rates=recorded.joint_rates_at(record),
        )
        elsewhere = np.array(joints) + random.normal(0.0, 0.4, 6)
        q, position = planner.mechanism.forward(tuple(elsewhere.tolist()))
        yield motion, record, moving, MotionRequest([Keyframe(q, position=position)])
        count -= 1


@pytest.mark.parametrize(("jerk", "least"), [(math.inf, 21), (1000.0, 11)])
def test_an_arm_in_motion_goes_elsewhere_without_a_stop(jerk, least):
    planned = 0
    for before, record, planner, request in retargets(25, jerk):
        try:
            motion = planner.plan(request)
        except PlanError:
            continue
        planned += 1
        joints = np.concatenate([before.path.joints[:record], motion.path.joints])
        shares = rates_of(joints, planner.mechanism.axes)
        assert max(float(one.max()) for one in shares) <= 1.001
        reached = planner.mechanism.forward(tuple(joints[-1].tolist()))
        (goal,) = request.keyframes
        assert reached[1] == pytest.approx(goal.position, abs=1e-6)
        assert angle(np.array(reached[0]), np.array(goal.q)) < 1e-6
        assert np.all(motion.path.joint_rates[-1] == 0.0)
    assert planned >= least


def near_singular(random):
    """Return the planner of an arm whose wrist is nearly straight, and a request for it."""
    arm = MODELS["ur5e"].arm()
    joints = HOME + random.uniform(-0.6, 0.6, 6)
    joints[4] = random.uniform(0.03, 0.3)
    there = arm.forward(tuple((joints + random.normal(0.0, 0.3, 6)).tolist()))
    second = arm.forward(tuple((joints + random.normal(0.0, 0.3, 6)).tolist()))
    keyframes = [Keyframe(one[0], position=one[1]) for one in (there, second)]
    return Arm(arm, tuple(joints.tolist())), MotionRequest(keyframes, approach=True)


@pytest.mark.parametrize("seed", [256, 379])
def test_a_move_whose_straight_way_is_singular_goes_another_way(seed):
    planner, request = near_singular(np.random.default_rng(seed))
    motion = planner.plan(request)
    speed, force, _ = rates_of(motion.path.joints, planner.mechanism.axes)
    assert max(float(speed.max()), float(force.max())) <= 1.001


def test_the_joint_velocities_of_records_are_those_of_the_path():
    planner, request = arm_request(np.random.default_rng(5))
    motion = planner.plan(request)
    step, exact = 1e-5, []
    for row, joints in zip(motion.rows(0, motion.record_count), motion.path.joints, strict=True):
        around = [
            planner.mechanism.nearest(
                tuple(multiply(row[:4], exp(way * row[4:7])).tolist()),
                tuple((row[10:13] + way * row[13:16]).tolist()),
                tuple(joints.tolist()),
            )
            for way in (-step, step)
        ]
        exact.append(np.diff(around, axis=0)[0] / (2.0 * step))
    # Differences of neighbours are wrong by 1.3e-3 rad/s here.
    assert np.abs(motion.path.joint_rates - exact).max() < 1e-4


def test_an_arm_meets_a_velocity_at_the_end_and_comes_to_rest_within_the_limits_of_its_joints():
    random, met = np.random.default_rng(8), 0
    for _ in range(20):
        planner, request = arm_request(random)
        wanted = random.normal(0.0, 0.25, 3)
        if request.is_single:
            continue
        try:
            motion = planner.plan(replace(request, end_velocity=tuple(wanted)))
        except PlanError:
            continue
        met += 1
        (end,) = motion.sample(np.array([motion.end_time])).omega_body
        assert end == pytest.approx(wanted, abs=1e-9)
        speed, force, _ = rates_of(motion.path.joints, planner.mechanism.axes)
        assert max(float(speed.max()), float(force.max())) <= 1.001
        assert np.all(motion.path.joint_rates[-1] == 0.0)
    assert met >= 11


def test_times_that_a_joint_cannot_keep_are_refused_with_a_duration_that_it_can():
    planner = Arm(MODELS["ur5e"].arm().slower(4.0), tuple(HOME.tolist()))
    there = planner.mechanism.forward((*HOME[:5].tolist(), 1.0))

    def taking(seconds):
        here = planner.mechanism.forward(planner.joints)
        frames = [Keyframe(q, at, p) for (q, p), at in ((here, 0.0), (there, seconds))]
        return planner.plan(MotionRequest(frames))

    with pytest.raises(LimitError, match=r"of wrist 3 reaches .* s in place of 1\.0 s") as caught:
        taking(1.0)
    seconds = float(re.search(r"([0-9.]+) s in place of", str(caught.value))[1])
    assert taking(seconds).duration == pytest.approx(seconds, abs=0.01)


@pytest.mark.parametrize("speed", [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4])
def test_an_arm_may_arrive_at_a_keyframe_with_hardly_any_velocity(speed):
    planner = Arm(MODELS["ur5e"].arm(), tuple(HOME.tolist()))
    q, position = planner.mechanism.forward(planner.joints)
    goal = Keyframe(
        tuple(multiply(np.array(q), exp(np.array([0.5, 0.0, 0.0]))).tolist()), position=position
    )
    still = planner.plan(MotionRequest([goal], approach=True))
    motion = planner.plan(MotionRequest([goal], approach=True, end_velocity=(speed, 0.0, 0.0)))
    assert motion.duration < 1.1 * still.duration


def test_an_endless_joint_may_turn_two_hundred_times():
    arm = MODELS["ur3e"].arm()
    planner = Arm(arm, tuple(HOME.tolist()))
    q, position = arm.forward(planner.joints)
    frames = [Keyframe(q, position=position)]
    there = arm.forward((*HOME[:5].tolist(), 1.0))
    frames.append(Keyframe(there[0], position=there[1], turns=200))
    motion = planner.plan(MotionRequest(frames))
    assert np.ptp(motion.path.joints[:, 5]) == pytest.approx(400.0 * math.pi + 1.0, abs=1e-6)


class Device:
    """A driver whose device is an arm."""

    name = "arm"

    def __init__(self, arm):
        self.arm = arm

    def mechanism(self, *, may_ask):
        return self.arm


def slow_arm():
    """Return the planner of an arm with slow joints, its pose, and turns of it about one axis."""
    arm, joints = MODELS["ur5e"].arm().slower(5.0), tuple(HOME.tolist())
    q, position = arm.forward(joints)
    planner = DevicePlanner(Device(arm), limits=LIMITS["arm"], period=PERIOD)
    start = State.at_rest(np.array(q), np.array(position))

    def turned(angle):
        return tuple(multiply(np.array(q), exp(np.array([0.0, 0.0, angle]))).tolist())

    return planner, start, joints, turned


def test_a_motion_that_joins_at_an_end_velocity_is_timed_for_the_axes():
    planner, start, joints, turned = slow_arm()
    velocity, keys = (0.0, 0.0, 0.2), [Keyframe(turned(one)) for one in (0.0, 0.6, 1.2)]
    first = planner.plan(
        MotionRequest(keys[:2], end_velocity=velocity), start=start, joints=joints
    ).recorded()
    request = MotionRequest(keys[1:], start_velocity=velocity)
    record, motion = planner.blend(first, request, tolerance=0.0, earliest=3)
    rows = [first.joints_at(one) for one in range(record)]
    shares = rates_of(np.concatenate([rows, motion.path.joints]), planner._examiner.arm.axes)
    assert max(float(one.max()) for one in shares[:2]) <= 1.001


def test_a_lead_in_around_a_cone_is_timed_for_the_axes():
    planner, start, joints, turned = slow_arm()
    direction = rotate(np.array(turned(0.5)), np.array([1.0, 0.0, 0.0]))
    cone = KeepOut("sun", tuple(direction.tolist()), 0.12, 0.0)
    keys = [Keyframe(turned(1.0), time=0.0), Keyframe(turned(1.3), time=3.0)]
    request = MotionRequest(keys, approach=True, keep_out=[cone])
    motion = planner.plan(request, start=start, joints=joints)
    shares = rates_of(motion.path.joints, planner._examiner.arm.axes)
    assert max(float(one.max()) for one in shares[:2]) <= 1.001
    assert any(one.startswith("led around") for one in motion.certificate.notes)
