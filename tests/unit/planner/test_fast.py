"""The compiled kernels of the planner against NumPy, and when they are sent for."""

import numpy as np
import pytest

from orientd.curves import fast as curves_fast
from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, State, fast, plan, retarget
from orientd.planner.brake import axis_brake_rate, brake_rate
from orientd.planner.course import Course
from orientd.planner.differences import Rough, differences, extremes
from orientd.planner.limits import ANGULAR
from orientd.planner.measuring import measure_path
from orientd.planner.methods import Ends, method_of
from orientd.planner.position import PositionPath
from orientd.planner.survey import Survey
from orientd.rotation import exp, multiply, normalize

PERIOD = 0.002
LIMITS = [DEFAULT_LIMITS, DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.7, 1.5], "jerk": 300.0})]


@pytest.fixture(scope="module")
def loaded():
    pytest.importorskip("numba")
    assert fast.wait_ready(), repr(fast.KERNELS.error)
    return fast.KERNELS


@pytest.fixture
def both(loaded, monkeypatch):
    """Call something with NumPy alone, and with the compiled kernels."""

    def call(work):
        with monkeypatch.context() as patch:
            patch.setattr(fast, "KERNELS", fast.PlannerKernels())
            fast.KERNELS.status = curves_fast.Status.MISSING
            reference = work()
        return reference, work()

    return call


@pytest.mark.parametrize("past", [0, 1])
@pytest.mark.parametrize("with_axes", [False, True])
def test_both_find_the_same_largest_differences(both, past, with_axes):
    rng = np.random.default_rng(past)
    for count in (1, 2, 3, 4, 255, 256, 257, 508, 509, 510, 2000):
        q = exp(np.cumsum(rng.normal(size=(count, 3)), axis=0))
        found, reference = both(lambda q=q: extremes(q, past=past, with_axes=with_axes))
        assert found.places == reference.places
        assert np.abs(np.subtract(found.largest, reference.largest)).max() <= 1e-12


def test_what_is_not_a_number_is_the_largest_difference(both):
    q = exp(np.linspace(0.0, 1.0, 40)[:, None] * np.ones(3))
    q[20] = np.nan
    for found in both(lambda: extremes(q)):
        assert np.isnan([row[0] for row in found.largest]).all()


@pytest.mark.parametrize("angle", [1e-12, 1e-4, 0.0624, 0.0625, 0.0626, 1.0, 3.0])
def test_both_take_the_same_differences_of_turns_of_any_size(both, angle):
    rng = np.random.default_rng(1)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = multiply(exp(rng.normal(size=3)), exp(angle * np.arange(5)[:, None] * axis))
    q *= rng.choice([-1.0, 1.0], 5)[:, None]
    for found in both(lambda: extremes(q, with_axes=True)):
        sizes = np.sqrt(found.largest[0])
        assert sizes == pytest.approx(angle * np.array([1.0, *np.abs(axis)]), rel=1e-12, abs=1e-15)
        assert np.sqrt(found.largest[1:]).max() <= 1e-15 + 1e-14 * angle


@pytest.mark.parametrize("limits", [LIMITS[0], LIMITS[1].with_rates({"jerk": [9e3, 5e3, 7e3]})])
@pytest.mark.parametrize("rough", [None, Rough(0.1, 0.3, 1), Rough(0.0, 9.0, 0)])
@pytest.mark.parametrize("count", [3, 4, 400])
def test_both_find_the_same_brake_rate_of_setpoints(both, limits, rough, count):
    times = PERIOD * np.arange(count)
    q = exp(np.stack([np.sin(2.0 * times), 0.5 * np.cos(3.0 * times), 0.1 * times], axis=1))
    work = {"start": 3 * PERIOD, "rough": rough, "brake_limits": limits, "period": PERIOD}
    reference, found = both(lambda: extremes(q, with_axes=limits.has_axes, **work))
    assert found.rate == pytest.approx(reference.rate, rel=1e-9)
    assert found.rate_place == reference.rate_place


@pytest.mark.parametrize("scale", [0.1, 0.9, 1.0, 1.2])
def test_both_find_the_same_brake_rate(both, scale):
    rng = np.random.default_rng(7)
    limits = LIMITS[1].with_rates({"acceleration": [9.0, 12.0, 15.0]})
    for count in (1, 500):
        omega, alpha, jerk = (
            scale * limit * rng.uniform(-0.55, 0.55, (count, 3)) for limit in (1.0, 12.0, 300.0)
        )
        size = np.linalg.norm(jerk, axis=1)
        for work in (
            lambda a=omega, b=alpha, c=size: brake_rate(a, b, c, limits),
            lambda a=omega, b=alpha, c=jerk: axis_brake_rate(a, b, c, limits),
        ):
            reference, found = both(work)
            assert found[0] == pytest.approx(reference[0], rel=1e-12)
            # Of several points where nothing is left either may be named.
            assert found[1] == reference[1] or found[0] == 0.0


def several_paths(limits):
    """Yield motions on paths of one to five stretches, run backwards and taken over, too."""
    rng = np.random.default_rng(6)
    here = State.at_rest([1.0, 0.0, 0.0, 0.0])
    keys = [tuple(q) for q in exp(0.3 * rng.normal(size=(5, 3))).tolist()]
    times = [0.0, 4.0, 9.0, 13.0, 17.0]
    timed = [Keyframe(q, t) for q, t in zip(keys, times, strict=True)]
    velocities = {"start_velocity": (0.2, 0.0, -0.1), "end_velocity": (0.0, 0.3, 0.0)}
    for keyframes, method, options in (
        ([Keyframe(keys[0])], "c2_cumulative", {}),
        ([Keyframe(keys[0])], "c2_cumulative", {"end_velocity": (0.0, 0.3, 0.0)}),
        ([Keyframe(q) for q in keys], "c2_cumulative", {}),
        (timed, "c2_cumulative", velocities),
        (timed, "kks_hermite_spline", velocities),
        (timed, "kks_hermite_spline", {}),
    ):
        request = MotionRequest(keyframes, method=method, approach=True, **options)
        for start in (here, retarget(keys[1], start=here, limits=limits, period=PERIOD)):
            state = start if start is here else start.state_at(start.record_count // 2)
            yield plan(request, start=state, limits=limits, period=PERIOD)


@pytest.mark.parametrize("limits", LIMITS)
def test_both_sample_the_same_paths(both, limits):
    counts, rates = set(), set()
    for motion in several_paths(limits):
        path = motion.path
        counts.add(len(path.stretches))
        rates |= {stretch.rate > 0.0 for stretch in path.stretches}
        inside = np.linspace(-0.1, path.duration + 0.1, 700)
        joints = [stretch.begin for stretch in path.stretches]
        times = np.sort(np.concatenate([inside, joints, np.nextafter(joints, -9.0)]))
        for some in (times, times[-1:], times[:0], inside[::-1]):
            reference, found = both(lambda path=path, some=some: path.sample(some))
            for part, other in zip(found, reference, strict=True):
                assert part == pytest.approx(other, abs=1e-12)
        keys, at = path.orientations(times[::7]), times[::7]
        reference, found = both(lambda path=path, q=keys, t=at: path.farthest_from(q, t + 0.01))
        assert found == pytest.approx(reference, rel=1e-9)
        assert found > 1e-3
    assert counts >= {1, 2, 4}
    assert rates == {True, False}


def value_at(path, name, time):
    """Return the size of a backward difference of a path that was held before."""
    times = np.arange(round(time / PERIOD) - 3, round(time / PERIOD) + 1) * PERIOD
    rate = differences(path.orientations(np.maximum(times, 0.0)))[ANGULAR.index(name)][-1]
    return np.linalg.norm(rate) / PERIOD ** (1 + ANGULAR.index(name))


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("rough", [None, Rough(0.1, 2.0, 1)])
def test_both_hold_the_same_paths_against_their_limits(both, limits, rough):
    for motion in several_paths(limits):
        path, count = motion.path, motion.record_count
        q = path.orientations(np.zeros(3))
        befores = [None, (q, np.zeros((3, 3))), (q, np.full((3, 3), 0.1))]
        for before in befores:
            reference, found = both(
                lambda before=before, path=path, count=count: measure_path(
                    path, count, PERIOD, limits, before=before, brake_limits=limits, rough=rough
                )
            )
            assert found.brake_rate == pytest.approx(reference.brake_rate, rel=1e-6)
            for name in ("velocity", "acceleration", "jerk", "linear_velocity"):
                one, other = getattr(found, name), getattr(reference, name)
                assert one.value == pytest.approx(other.value, rel=1e-6)
                if name in ANGULAR:
                    # Of several that are as large either may be named.
                    assert value_at(path, name, one.time) == pytest.approx(one.value, rel=1e-6)
            for name in ("axis_velocity", "axis_acceleration", "axis_jerk"):
                row, rows = getattr(found, name), getattr(reference, name)
                assert [p.value for p in row] == pytest.approx([p.value for p in rows], rel=1e-6)


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("count", [2, 5, 80])
@pytest.mark.parametrize("end_velocity", [None, (0.0, 0.2, 0.0)])
def test_both_survey_and_look_alike(both, limits, count, end_velocity):
    keys = np.array([4.0, 0.0, 0.0, 0.0]) + np.random.default_rng(count).normal(size=(count, 4))
    asked = MotionRequest([Keyframe(tuple(q)) for q in normalize(keys).tolist()])
    ends = Ends(None, end_velocity and np.array(end_velocity), None)
    halt = PositionPath.held(np.zeros(3))
    times = np.linspace(0.0, 1.0, count)
    course = Course(asked, method_of(asked.method), ends, times, np.arange(count), halt)
    core = course.core(1.4 * count)

    def surveyed():
        found = Survey.of(core, limits, PERIOD, has_one_shape=True)
        looks = [found.look(core, limits, PERIOD, everywhere=each) for each in (False, True)]
        return found.factor, *looks, *found.spots.reshape(-1)

    reference, found = both(surveyed)
    assert found == pytest.approx(reference, rel=1e-12)


@pytest.mark.parametrize("limits", LIMITS)
def test_both_plan_the_same_motions(both, limits):
    rng = np.random.default_rng(5)
    here = State.at_rest([1.0, 0.0, 0.0, 0.0])
    target = normalize(rng.normal(size=4))
    first = retarget(target, start=here, limits=limits, period=PERIOD)
    start = first.state_at(first.record_count // 2)
    keys = [tuple(q) for q in normalize(np.array([1, 0, 0, 0]) + rng.normal(size=(5, 4))).tolist()]
    request = MotionRequest([Keyframe(q) for q in keys], approach=True)
    for work in (
        lambda: retarget(keys[0], start=start, limits=limits, period=PERIOD),
        lambda: plan(request, start=start, limits=limits, period=PERIOD),
    ):
        reference, found = both(work)
        assert found.record_count == reference.record_count
        assert found.certificate.stop_time == pytest.approx(reference.certificate.stop_time)
        records = (motion.records(0, motion.record_count)[:, :4] for motion in (found, reference))
        assert np.abs(np.subtract(*records)).max() <= 1e-11


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("step", [0.01, 0.3, 2.8])
@pytest.mark.parametrize("count", [3, 20, 70])
def test_the_quick_way_to_a_core_says_what_the_ordinary_one_says(
    loaded, monkeypatch, limits, step, count
):
    rng = np.random.default_rng(count)
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for turn in exp(step * rng.uniform(-1.0, 1.0, (count - 1, 3))):
        keys.append(rng.choice([-1.0, 1.0]) * multiply(keys[-1], turn))
    request = MotionRequest([Keyframe(tuple(q)) for q in normalize(np.array(keys)).tolist()])
    start = State.at_rest(request.keys[0])
    found = plan(request, start=start, limits=limits, period=PERIOD)
    monkeypatch.setattr(loaded, "quick_core", None)
    reference = plan(request, start=start, limits=limits, period=PERIOD)
    assert found.record_count == reference.record_count
    assert found.keyframe_times == pytest.approx(reference.keyframe_times, rel=1e-13)
    records = (motion.records(0, motion.record_count)[:, :4] for motion in (found, reference))
    assert np.abs(np.subtract(*records)).max() <= 1e-12


def test_a_keyframe_that_is_repeated_goes_the_ordinary_way(loaded):
    keys = [(1.0, 0.0, 0.0, 0.0), (0.8, 0.6, 0.0, 0.0), (0.8, 0.6, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)]
    request = MotionRequest([Keyframe(q) for q in keys])
    start = State.at_rest(keys[0])
    motion = plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)
    assert motion.keyframe_times[1] == motion.keyframe_times[2]


def test_the_kernels_are_sent_for_once_those_of_the_curves_are_in_use(loaded, monkeypatch):
    monkeypatch.setattr(fast, "KERNELS", fast.PlannerKernels())
    monkeypatch.setattr(curves_fast, "KERNEL", curves_fast.FastKernel())
    assert fast.kernels().status is curves_fast.Status.NOT_STARTED
    curves_fast.KERNEL.status = curves_fast.Status.READY
    assert fast.kernels().status is not curves_fast.Status.NOT_STARTED
    assert fast.KERNELS.wait_ready(60.0)
    assert fast.kernels().survey is not None


def test_without_numba_numpy_plans_on(monkeypatch):
    monkeypatch.setattr(curves_fast, "find_spec", lambda name: None)
    kernels = fast.PlannerKernels()
    assert not kernels.wait_ready(60.0)
    assert kernels.status is curves_fast.Status.MISSING
    assert kernels.survey is None
