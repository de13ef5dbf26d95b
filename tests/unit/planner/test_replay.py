"""A replay repeats a recording inside the limits, at its speed or slower."""

import numpy as np
import pytest
from hand_held import recorded, truth
from reference.aims import end_state

from orientd import rotation
from orientd.curves.fitting import fit_orientations
from orientd.errors import PlanError, RequestError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner import planning
from orientd.planner.state import State
from orientd.planner.task import plan_as_recorded, replay_request

PERIOD = 0.002
NARROW = Limits(1.0, 5.0, 100.0, 1.0, 10.0)


@pytest.fixture(scope="module")
def fit():
    return fit_orientations(*recorded(0, seconds=12.0))


def planned_for(limits, start=(1.0, 0.0, 0.0, 0.0)):
    def plan(request):
        at = State.at_rest(start)
        return planning.plan(request, start=at, limits=limits, period=PERIOD)

    return plan


def peaks(motion):
    """Return the largest backward differences of the records, from rest to rest."""
    q = motion.records(0, motion.record_count)[:, :4]
    q = np.vstack([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])
    omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / PERIOD
    alpha = np.diff(omega, axis=0) / PERIOD
    derivatives = omega, alpha, np.diff(alpha, axis=0) / PERIOD
    return [float(np.linalg.norm(d, axis=1).max()) for d in derivatives]


@pytest.mark.parametrize("limits", [DEFAULT_LIMITS, NARROW], ids=["default", "narrow"])
def test_a_replay_keeps_the_limits_from_rest_to_rest(fit, limits):
    motion, _, _ = plan_as_recorded(fit, planned_for(limits))
    velocity, acceleration, jerk = peaks(motion)
    assert velocity <= limits.velocity * 1.001
    assert acceleration <= limits.acceleration * 1.001
    assert jerk <= limits.jerk * 1.001


def test_a_recording_at_rest_is_nothing_to_replay():
    t = np.arange(0.0, 2.0, 0.02)
    fit = fit_orientations(t, np.tile(truth(1.0), (len(t), 1)))
    with pytest.raises(PlanError, match="at rest: its 100 samples have one orientation"):
        plan_as_recorded(fit, planned_for(DEFAULT_LIMITS))


def test_a_replay_within_the_limits_is_as_fast_as_what_was_recorded(fit):
    motion, _, slower = plan_as_recorded(fit, planned_for(DEFAULT_LIMITS))
    assert slower == 1.0
    times = np.linspace(0.0, np.ptp(fit.times), 400)
    sampled = motion.sample(motion.start_time + times).q
    error = rotation.angle(sampled, truth(fit.times[0] + times))
    assert float(error.max()) <= np.radians(1.0)


def test_a_replay_that_would_break_the_limits_is_slowed_down_evenly(fit):
    motion, _, slower = plan_as_recorded(fit, planned_for(NARROW))
    assert slower > 1.1
    assert motion.end_time - motion.start_time == pytest.approx(slower * np.ptp(fit.times))
    times = np.linspace(0.0, np.ptp(fit.times), 400)
    sampled = motion.sample(motion.start_time + slower * times).q
    exact = fit.curve.evaluate(fit.times[0] + times)[0]
    assert float(rotation.angle(sampled, exact).max()) < 1e-9


def test_the_quickest_replay_is_quicker_and_keeps_the_curve(fit):
    plan = planned_for(NARROW)
    slow, _, _ = plan_as_recorded(fit, plan)
    quick = plan(replay_request(fit))
    assert quick.duration < slow.duration
    assert peaks(quick)[0] <= NARROW.velocity * 1.001
    curve = fit.curve.evaluate(np.linspace(*fit.curve.domain, 20_000))[0]
    for t in np.linspace(quick.start_time, quick.end_time, 40):
        assert float(rotation.angle(quick.sample([t]).q, curve).min()) < 2e-3


def test_knots_come_through_a_motion_file(fit):
    from orientd import motion_file

    request = replay_request(fit, slower=1.0)
    again = motion_file.parse(motion_file.written(request))
    assert list(again.options["knots"]) == list(request.options["knots"])
    plan = planned_for(DEFAULT_LIMITS)
    one, other = plan(request), plan(again)
    assert float(rotation.angle(end_state(one).q, end_state(other).q)) < 1e-9
    assert one.duration == pytest.approx(other.duration)


@pytest.mark.parametrize(
    ("knots", "problem"),
    [
        ([0.0] * 5, "list of 8 non-decreasing numbers .* got .* shape .5,"),
        ([0, 0, 0, 0, 1, 1, 1, 0.5], "must not decrease"),
        ([1.0] * 8, "must leave a domain"),
        ("many", "8 non-decreasing numbers"),
    ],
)
def test_knots_that_are_none_are_refused(knots, problem):
    keyframes = [Keyframe(tuple(q)) for q in truth(np.arange(4.0)).tolist()]
    request = MotionRequest(
        keyframes, method="kks_bspline", approach=True, options={"knots": knots}
    )
    with pytest.raises(RequestError, match=problem) as caught:
        planned_for(DEFAULT_LIMITS)(request)
    assert caught.value.field == "options.knots"
