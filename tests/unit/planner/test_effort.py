"""How much is tried for a plan at most, counted: evaluations, not seconds."""

import numpy as np
import pytest
from planned import PERIOD
from reference.aims import end_state, retarget

from orientd.errors import PlanError
from orientd.planner import DEFAULT_LIMITS, Keyframe, Limits, MotionRequest, State, job, plan
from orientd.planner.job import PlanJob
from orientd.planner.timing import even
from orientd.planner.timing.even import shortest
from orientd.rotation import exp, multiply, normalize

# Requests that begin in motion, as random search found them: the largest steps, accelerations and
# velocities that no duration of the curve goes with.  They once took 13 to 28 s to refuse.
WORST = {
    "a curve that the acceleration cannot be joined to": (
        "kks_hermite_spline", (1.0, 30.0, 5.0), [-0.0542, -0.0057, -0.0749], [1.256, 0.468, -6.659],
        [[0.357082, -0.27681, -0.887544, 0.090185], [-0.470648, -0.469967, -0.330948, 0.669399],
         [-0.464878, -0.147705, 0.765638, 0.419369], [-0.122633, 0.507981, -0.02997, 0.852067]],
    ),
    "small steps with little jerk": (
        "kks_hermite_spline", (0.3, 5.0, 5.0), [0.0, 0.0783, 0.2301], [1.006, -0.443, -0.566],
        [[0.706246, -0.395343, -0.576224, 0.113518], [0.705354, -0.395395, -0.578151, 0.108993],
         [0.703981, -0.392979, -0.581824, 0.107047], [0.701855, -0.391236, -0.585792, 0.105744]],
    ),
    "hardly any velocity allowed": (
        "c2_cumulative", (0.3, 17.0, 8500.0), [0.0083, 0.0252, 0.0031], [1.393, -0.009, -2.651],
        [[0.142536, -0.600365, 0.323472, -0.717364], [0.976868, -0.074762, -0.032642, -0.197671],
         [0.459164, 0.387627, -0.51874, 0.608131]],
    ),
    "longer ones swing out further": (
        "c2_cumulative", (1.0, 5.0, 5.0), [0.348, 0.4804, 0.1308], [-1.196, -0.95, 2.307],
        [[0.10556, 0.269973, -0.809571, 0.510457], [0.13865, -0.370605, -0.790236, -0.467926],
         [0.694221, 0.18311, 0.047107, -0.694485]],
    ),
}  # fmt: skip


@pytest.fixture
def effort(monkeypatch):
    """Count curves, and records that are looked at."""
    spent = {"curves": 0, "records": 0}
    path, time_even, measure = PlanJob.path, even.time_even, job.measure

    def counted_core(*arguments, **options):
        spent["curves"] += 1
        return path(*arguments, **options)

    def counted_time_even(*arguments):
        # One look at no more than all records.
        *_, least, most = arguments
        spent["records"] += least if least == most else 0
        return time_even(*arguments)

    def counted_measure(whole, count, *arguments, **options):
        spent["records"] += count
        return measure(whole, count, *arguments, **options)

    monkeypatch.setattr(PlanJob, "path", counted_core)
    monkeypatch.setattr(even, "time_even", counted_time_even)
    monkeypatch.setattr(job, "measure", counted_measure)
    return spent


def plan_worst(name):
    method, (velocity, acceleration, jerk), omega, alpha, keys = WORST[name]
    limits = Limits.partial(velocity=velocity, acceleration=acceleration, jerk=jerk)
    keys = normalize(np.array(keys))
    start = State(keys[0], np.array(omega), np.array(alpha), np.zeros(3))
    request = MotionRequest([Keyframe(tuple(q)) for q in keys.tolist()], method=method)
    return plan(request, start=start, limits=limits, period=PERIOD)


@pytest.mark.parametrize("name", WORST)
def test_what_no_duration_helps_is_refused_or_rests_soon(effort, name):
    method, *_ = WORST[name]
    if method == "c2_cumulative":
        assert plan_worst(name).certificate.keyframe_error < 1e-9
    else:
        with pytest.raises(PlanError, match="approach: true"):
            plan_worst(name)
    assert 1 < effort["curves"] <= 50
    assert 10_000 < effort["records"] <= 3_000_000


def test_what_goes_on_from_a_motion_is_planned_with_few_curves(effort):
    random = np.random.default_rng(2)
    here = State.at_rest([1.0, 0.0, 0.0, 0.0])
    planned = 0
    for _ in range(12):
        target = exp(random.uniform(-2.0, 2.0, 3))
        first = retarget(target, start=here, limits=DEFAULT_LIMITS, period=PERIOD)
        start = first.state_at(int(random.integers(first.record_count)))
        keys = [start.q, end_state(first).q]
        keys += [multiply(keys[-1], exp(random.uniform(-1.0, 1.0, 3)))]
        request = MotionRequest([Keyframe(tuple(q)) for q in normalize(np.array(keys)).tolist()])
        effort.update(curves=0, records=0)
        try:
            plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)
            planned += 1
        except PlanError:
            pass
        assert 1 < effort["curves"] <= 30
        assert 100 < effort["records"] <= 100_000
    assert planned >= 6


def test_the_search_turns_to_fewer_cycles_where_more_are_worse():
    tried = []

    def attempt(cycles):
        tried.append(cycles)
        return max(0.9, 400.0 / cycles, cycles / 800.0)

    found = shortest(attempt, 3000, most=10**7)
    assert found == pytest.approx(400, rel=2e-3)
    assert found in tried
    assert len(tried) < 25


def test_the_search_gives_up_where_the_least_is_too_much():
    tried = []

    def attempt(cycles):
        tried.append(cycles)
        return np.inf if cycles > 5000 else max(400.0 / cycles, cycles / 300.0)

    assert shortest(attempt, 3000, most=10**7) is None
    assert len(tried) < 20
    assert max(tried) < 10_000
