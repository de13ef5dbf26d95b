"""Gimbals pass their poles, and slew, in one timing of tool and axes."""

from types import SimpleNamespace

import numpy as np
import pytest

from orientd.driver import AxisLimits
from orientd.mechanism import Gimbal
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import angle, exp, multiply

LIMITS = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)
PERIOD = 0.01


class Head:
    """A head of three axes that is sent past the zenith, at a distance in radians."""

    def __init__(self, miss, *, tilt=(-4.7, 4.7), **options):
        axes = [
            AxisLimits("yaw", -4.7, 4.7, 4.0, 30.0),
            AxisLimits("tilt", *tilt, 4.0, 30.0),
            AxisLimits("roll", -4.7, 4.7, 4.0, 30.0),
        ]
        self.gimbal = Gimbal(axes, order="ZYX", **options)
        self._aside = exp(np.array([miss, 0.0, 0.0]))
        self.joints, _ = self.gimbal.solve(self.at(1.0), (0.0, 1.0, 0.0))

    def at(self, tilt):
        """Return the orientation at a place of the great circle, rad."""
        return tuple(multiply(self._aside, self.gimbal.orientation((0.0, tilt, 0.0))).tolist())

    def plan(self, *tilts):
        """Plan the motion through several places, and hold it against the limits."""
        driver = SimpleNamespace(name="head", mechanism=lambda *, may_ask: self.gimbal)
        planner = DevicePlanner(driver, limits=LIMITS, period=PERIOD)
        request = MotionRequest([Keyframe(self.at(tilt)) for tilt in tilts], approach=True)
        start = State.at_rest(np.array(self.gimbal.orientation(self.joints)), (0.0, 0.0, 0.0))
        motion = planner.plan(request, start=start, joints=self.joints)
        self.assert_keeps_limits(motion)
        return motion

    def assert_keeps_limits(self, motion):
        joints = motion.path.joints
        made = np.array([self.gimbal.orientation(tuple(row)) for row in joints.tolist()])
        assert np.max(angle(made, motion.path.table[:, :4])) < 1e-9
        rows = np.concatenate([joints[[0, 0]], joints, joints[[-1, -1]]])
        for place, axis in enumerate(self.gimbal.axes):
            rate, force = (np.diff(rows[:, place], n) / PERIOD**n for n in (1, 2))
            assert np.abs(rate).max() <= 1.001 * axis.velocity
            assert np.abs(force).max() <= 1.001 * axis.acceleration
            assert axis.low - 1e-9 <= joints[:, place].min()
            assert joints[:, place].max() <= axis.high + 1e-9

    def off(self, motion):
        """Return the largest distance of a motion from its great circle, rad."""
        circle = np.array([self.at(tilt) for tilt in np.linspace(0.9, 2.4, 6001)])
        nearest = np.max(np.abs(motion.path.table[:, :4] @ circle.T), axis=1)
        return float(2.0 * np.arccos(np.min(nearest).clip(-1.0, 1.0)))


def figure(motion, name):
    return next(one for one in motion.certificate.figures if one.name == name)


@pytest.mark.parametrize("miss", [0.1, 0.01, 0.004])
def test_a_gimbal_passes_beside_its_pole_exactly_within_its_limits(miss):
    head = Head(miss)
    motion = head.plan(1.3, 2.2)
    assert head.off(motion) < 2e-3
    assert figure(motion, "pointing error").value == 0.0
    assert motion.duration < 2.0


@pytest.mark.parametrize("miss", [1e-4, 3e-4, 1e-3])
def test_very_close_to_a_pole_the_path_stops_while_the_axes_slew(miss):
    head = Head(miss)
    motion = head.plan(1.3, 2.2)
    assert any("at the pole the path stops" in note for note in motion.certificate.notes)
    assert head.off(motion) < np.deg2rad(0.5)
    assert motion.duration < 1.5


@pytest.mark.parametrize("miss", [1e-5, 1e-3, 0.02])
def test_a_deviation_leads_through_a_pole_without_a_stop(miss):
    head = Head(miss, max_deviation=0.03)
    motion = head.plan(1.3, 2.2)
    assert figure(motion, "pointing error").value == pytest.approx(miss, rel=1e-3)
    assert head.off(motion) < 1.01 * miss + 1e-3
    assert motion.duration < 0.9


@pytest.mark.parametrize("miss", [0.0, 1e-6, 1e-3])
def test_a_tilt_that_ends_at_the_pole_turns_around_there(miss):
    motion = Head(miss, tilt=(-0.4, np.pi / 2)).plan(1.3, 2.0)
    assert np.ptp(motion.path.joints[:, 0]) == pytest.approx(np.pi, abs=0.2)


def test_an_axis_unwinds_at_rest_as_fast_as_the_limits_allow():
    head = Head(0.0, tilt=(-1.0, 1.0), allow_slews=True)
    head.joints = (3.0, 0.2, 0.0)
    turns = [Keyframe(head.gimbal.orientation((yaw, 0.2, 0.0))) for yaw in (3.5, 4.5, 5.5)]
    driver = SimpleNamespace(name="head", mechanism=lambda *, may_ask: head.gimbal)
    planner = DevicePlanner(driver, limits=LIMITS, period=PERIOD)
    start = State.at_rest(np.array(head.gimbal.orientation(head.joints)), (0.0, 0.0, 0.0))
    request = MotionRequest(turns, approach=True)
    motion = planner.plan(request, start=start, joints=head.joints)
    head.assert_keeps_limits(motion)
    (loss,) = motion.certificate.losses
    assert 3.0 < loss.error <= np.pi
    # A whole turn of the tool at 2.5 rad/s.
    assert loss.end - loss.start < 1.15 * 2.0 * np.pi / 2.5
