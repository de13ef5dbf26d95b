"""Gimbals of every order are sent from anywhere to anywhere, poles included, and home again."""

import os
from itertools import pairwise, product

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from orientd import motion_file
from orientd.errors import LimitError, PlanError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import angle, rotate
from orientd_dynamixel import DynamixelDriver

PERIOD = 0.01
LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
ORDERS = [
    "".join(letters)
    for count in (2, 3)
    for letters in product("XYZ", repeat=count)
    if all(a != b for a, b in pairwise(letters))
]
RANGES = [(-270, 270), (-180, 180), (-100, 100), (-90, 90), (-90, 0), (-20, 200)]
CASES = int(os.environ.get("ORIENTD_CASES", "10"))


class Sequence:
    """A gimbal whose motions are planned one after the other, and sent as its driver sends them."""

    def __init__(self, order, ranges, **options):
        axes = [
            {"id": k + 1, "name": f"axis {k}", "limits_deg": [*limits], "velocity_deg": 220}
            for k, limits in enumerate(ranges)
        ]
        self.driver = DynamixelDriver(
            {"port": "virtual", "order": order, "axes": axes, **options},
            period_ns=10_000_000, clock=ManualClock(1),
        )  # fmt: skip
        self.axes = self.driver.settings.axes
        self.planner = DevicePlanner(self.driver, limits=LIMITS, period=PERIOD)
        self.gimbal = self.driver.mechanism(may_ask=False)
        self.angles = (0.0, 0.0, 0.0)[: len(axes)]
        self.q = np.array(self.gimbal.orientation(self.angles))

    def stand(self, *degrees):
        self.angles = tuple(np.deg2rad(degrees))
        self.q = np.array(self.gimbal.orientation(self.angles))
        return self

    @property
    def degrees(self):
        return np.rad2deg(self.angles)

    def go(self, request):
        """Plan a motion, send it, hold what the axes do against their limits; return it."""
        motion = self.planner.plan(request, start=State.at_rest(self.q), joints=self.angles)
        sent = motion.records(0, motion.record_count)[:, :4]
        # The servo begins a path nowhere but at what was commanded last.
        assert min(np.abs(sent[0] - self.q).max(), np.abs(sent[0] + self.q).max()) < 1e-9
        joints = motion.path.joints
        made = [self.gimbal.orientation(tuple(row)) for row in joints.tolist()]
        assert np.max(angle(np.array(made), sent)) < 1e-7
        angles = np.concatenate([[self.angles] * 2, joints, joints[[-1, -1]]])
        self.angles = motion.last_joints
        rate, force = np.diff(angles, axis=0) / PERIOD, np.diff(angles, 2, axis=0) / PERIOD**2
        for k, axis in enumerate(self.axes):
            # Beyond an end the servo stays at it, less than a tick away.
            low, high = axis.low - axis.resolution, axis.high + axis.resolution
            assert low <= angles[:, k].min() <= angles[:, k].max() <= high
            assert np.abs(rate[:, k]).max() <= 1.002 * axis.velocity
            assert np.abs(force[:, k]).max() <= 1.01 * axis.acceleration
        self.q = sent[-1]
        return motion

    def point(self, *directions, **fields):
        """Point to azimuths and elevations, deg."""
        keyframes = [
            {"azimuth_elevation": {"azimuth": azimuth, "elevation": elevation}}
            for azimuth, elevation in directions
        ]
        for keyframe, time in zip(keyframes, fields.pop("times", ()), strict=False):
            keyframe["time"] = time
        return self.go(motion_file.parse({"keyframes": keyframes, "approach": True, **fields}))

    def point_to(self, direction):
        """Point the innermost axis of three, or the one that two point, in *direction*."""
        axis = "xyz"[self.gimbal.kinematics.inner_axis]
        return self.go(
            motion_file.parse(
                {"keyframes": [{"direction": direction.tolist()}], "approach": True,
                 "pointing_axis": axis}
            )
        )  # fmt: skip

    def points(self, q):
        """Return where *q* points that axis."""
        return rotate(q, np.eye(3)[self.gimbal.kinematics.inner_axis])

    def home(self):
        anywhere = Keyframe((1.0, 0.0, 0.0, 0.0))
        return self.go(MotionRequest([anywhere], device_options={"home": True}))

    def misses(self, q):
        """Return by how much the tool misses *q*, with two axes its direction."""
        if len(self.axes) == 3:
            return float(angle(self.q, q))
        return float(np.linalg.norm(self.points(self.q) - self.points(q)))


def drawn(rng):
    """Return a gimbal, and whether its axes stand and turn where they are told."""
    order = ORDERS[rng.integers(len(ORDERS))]
    ranges = [RANGES[rng.integers(len(RANGES))] for _ in order]
    return Sequence(order, ranges, allow_slews=bool(rng.integers(2)))


def aim(it, rng):
    """Return axis angles inside the limits, deg: anywhere, at a pole or nearly there."""
    angles = np.array([rng.uniform(np.rad2deg(a.low), np.rad2deg(a.high)) for a in it.axes])
    if rng.random() < 0.3:
        angles = np.round(angles / 45) * 45
    if rng.random() < 0.5:
        first = 0 if it.gimbal.kinematics.inner_axis == it.gimbal.kinematics.axes[0] else 90
        poles = np.array([first - 180, first, first + 180], dtype=float)
        low, high = np.rad2deg([it.axes[1].low, it.axes[1].high])
        poles = poles[(poles >= low) & (poles <= high)]
        if len(poles):
            angles[1] = rng.choice(poles)
            if rng.random() < 0.3:
                angles[1] += rng.choice([-1, 1]) * 10 ** rng.uniform(-6, 0)
    low, high = np.rad2deg([[a.low for a in it.axes], [a.high for a in it.axes]])
    return np.clip(angles, low, high)


@pytest.mark.parametrize("case", range(CASES))
def test_ten_pointings_and_home(case):
    rng = np.random.default_rng([45, case])
    it = drawn(rng)
    for _ in range(10):
        q = np.array(it.gimbal.orientation(np.deg2rad(aim(it, rng))))
        if rng.random() < 0.7:
            it.go(MotionRequest([Keyframe(tuple(q.tolist()))]))
            assert it.misses(q) < 1e-5
            continue
        it.point_to(it.points(q))
        assert it.points(it.q) == pytest.approx(it.points(q), abs=1e-5)
    it.home()
    # A tick is 0.09 deg.
    assert it.degrees == pytest.approx([0.0] * len(it.axes), abs=0.03)


def two_axes(**options):
    return Sequence("ZY", [(-270, 270), (-90, 0)], **options)


def three_axes(**options):
    return Sequence("ZYX", [(-270, 270), (-100, 100), (-120, 120)], **options)


@pytest.mark.parametrize("make", [two_axes, three_axes])
def test_keyframes_without_times_go_on_from_the_pole_and_over_it(make):
    it = make().stand(*[100, -90, 0][: 2 + (make is three_axes)])
    motion = it.point((10, 40), (-30, 20))
    assert motion.duration < 5.0
    assert it.points(it.q) @ it.points(motion.request.keys[-1]) == pytest.approx(1.0, abs=1e-9)
    it.home()


def test_a_way_over_the_pole_that_ends_behind_it_turns_there():
    it = two_axes()
    motion = it.point((0, 60), (0, 90), (180, 60))
    assert any("stops and the axes slew" in note for note in motion.certificate.notes)
    assert abs(it.degrees[0]) == pytest.approx(180, abs=1e-3)
    assert it.degrees[1] == pytest.approx(-60, abs=1e-3)


def test_times_that_leave_no_turn_at_the_pole_are_refused_with_what_would_do():
    with pytest.raises(PlanError, match="leave out the times"):
        two_axes().stand(0, -90).point((0, 90), (100, 45), times=(0, 5))


def test_a_lead_in_turns_at_the_pole_before_the_times_begin():
    it = two_axes()
    it.point((0, 90))
    motion = it.point((100, 60), (120, 45), times=(0, 3))
    assert motion.keyframe_times[1] - motion.keyframe_times[0] == pytest.approx(3.0, abs=0.011)
    assert it.degrees == pytest.approx([120, -45], abs=1e-3)


@pytest.mark.parametrize("fields", [{"duration": 12.0}, {"pace": 0.25}])
def test_a_turn_of_the_axes_takes_as_long_as_asked_for(fields):
    quickest = two_axes().stand(100, -90).point((0, 45)).duration
    motion = two_axes().stand(100, -90).point((0, 45), **fields)
    wanted = fields.get("duration", quickest / fields.get("pace", 1.0))
    assert motion.duration == pytest.approx(wanted, abs=0.011)


def test_a_duration_too_short_for_the_axes_is_refused_with_the_least():
    with pytest.raises(PlanError, match="take at least"):
        two_axes().stand(100, -90).point((0, 45), duration=0.9)


def test_an_orientation_that_no_axis_angles_make_is_refused_for_that_axis():
    it = three_axes().stand(100, -90, 0)
    q = it.gimbal.orientation(np.deg2rad([0, -20, 150]))
    with pytest.raises(LimitError, match="angle of axis 2"):
        it.go(MotionRequest([Keyframe(tuple(q))]))


def test_home_from_a_motion_is_planned_from_rest_only():
    it = three_axes()
    motion = it.point((60, 30))
    middle = motion.record_count // 2
    with pytest.raises(PlanError, match="from rest only"):
        it.planner.plan(
            MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0))], device_options={"home": True}),
            start=motion.state_at(middle), joints=motion.recorded().joints_at(middle),
            before=motion.path.joints_before(middle),
        )  # fmt: skip
