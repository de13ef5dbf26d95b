"""The quickest timing of a curve, against other people's solvers and by SciPy's differences."""

import json
import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from planned import LIMITS, PERIOD, anywhere, differences, random_request, rotations, times_of
from reference.ruckig_turn import fastest

from orientd.curves import METHODS
from orientd.errors import RequestError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.measuring import measure
from orientd.planner.certify.summary import before
from orientd.planner.job import PlanJob
from orientd.planner.path.path import Path
from orientd.planner.path.position import PositionPath
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.profiles import aimed_at, quickest
from orientd.rotation import exp, multiply
from orientd.tolerances import GUARD_TOLERANCE

HERE = (1.0, 0.0, 0.0, 0.0)
OPTIMA = json.loads((FilePath(__file__).parents[2] / "data/quickest/optima.json").read_text())


def about_z(turn):
    return (math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2))


def made(keyframes, limits, *, start=None, period=PERIOD, **fields):
    request = MotionRequest(keyframes, duration="minimum", **fields)
    start = State.at_rest(request.keys[0]) if start is None else start
    return plan(request, start=start, limits=limits, period=period)


def even(request):
    return MotionRequest(**{**request.given(), "pace": "even"})


def alone(motion):
    """Return the time from the first keyframe to the last."""
    return motion.end_time - motion.start_time


def core_of(seed, *, count=6, step=0.6, at_rest=True):
    """Return a keyframe path on the default curve through random keyframes."""
    random = np.random.default_rng(seed)
    keys = np.array(rotations(random, count, step))
    signs = np.sign(np.sum(keys[1:] * keys[:-1], axis=1))
    keys[1:] *= np.cumprod(signs)[:, None]
    speed = 0.0 if at_rest else 0.3
    curve = METHODS["c2_cumulative"](
        keys=keys,
        times=np.arange(count, dtype=float),
        start="clamped",
        end="clamped",
        omega_start=speed * random.normal(size=3),
        omega_end=speed * random.normal(size=3),
    )
    positions = PositionPath.held(np.zeros(3))
    return KeyframePath(curve.trajectory, positions, np.arange(count, dtype=float))


@pytest.mark.parametrize("turn", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("name", ["arm", "quick"])
def test_a_turn_about_one_axis_takes_as_long_as_with_ruckig(turn, name):
    limits = LIMITS[name]
    durations = [
        fastest(turn, used.velocity, used.acceleration, used.jerk)
        for used in (limits, aimed_at(limits))
    ]
    motion = made([Keyframe(HERE), Keyframe(about_z(turn))], limits)
    assert alone(motion) == pytest.approx(durations[1], rel=1e-9)
    # That is the price of the reserve to stop with.
    assert alone(motion) < 1.0102 * durations[0]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("at_rest", [True, False])
def test_without_jerk_limit_it_takes_as_long_as_with_toppra(seed, at_rest):
    toppra = pytest.importorskip("toppra")
    keyframe_path = core_of(seed, at_rest=at_rest)
    velocity, acceleration = np.array([1.5, 1.2, 1.8]), np.array([4.0, 6.0, 5.0])
    limits = Limits.partial(velocity=velocity, acceleration=acceleration)
    quick = quickest(keyframe_path, limits, 0.001)
    used = aimed_at(limits)
    velocity, acceleration = np.array(used.axes("velocity")), np.array(used.axes("acceleration"))

    class Curve(toppra.interpolator.AbstractGeometricPath):
        """Omega and alpha are as linear in the rates of the parameter as those of joints."""

        path_interval, dof = (0.0, keyframe_path.duration), 3
        waypoints = None

        def __call__(self, places, order=0):
            _, omega, alpha = keyframe_path.trajectory.sample(
                np.atleast_1d(np.asarray(places, dtype=float))
            )
            rows = omega if order == 1 else alpha if order == 2 else 0.0 * omega
            return rows if np.ndim(places) else rows[0]

    box = [
        kind(np.stack([-most, most], axis=1))
        for kind, most in (
            (toppra.constraint.JointVelocityConstraint, velocity),
            (toppra.constraint.JointAccelerationConstraint, acceleration),
        )
    ]
    solver = toppra.algorithm.TOPPRA(
        box,
        Curve(),
        gridpoints=np.linspace(0.0, keyframe_path.duration, 3001),
        solver_wrapper="seidel",
    )
    ends = (0.0, 0.0) if at_rest else (1.0, 1.0)
    _, rate, _ = solver.compute_parameterization(*ends)
    step = keyframe_path.duration / 3000
    peer = float(np.sum(2.0 * step / (rate[1:] + rate[:-1])))
    assert quick.duration == pytest.approx(peer, rel=0.02)


@pytest.mark.parametrize("case", OPTIMA, ids=lambda case: case["name"])
def test_with_jerk_limit_it_is_near_the_optimum_found_on_a_fine_grid(case):
    limits = DEFAULT_LIMITS.with_rates(case["limits"])
    request = MotionRequest([Keyframe(tuple(q)) for q in case["keyframes"]], pace="even")
    start = State.at_rest(request.keys[0])
    usual = plan(request, start=start, limits=limits, period=PERIOD)
    chords = KeyframePath(usual.path.trajectory, usual.path.positions, usual.keyframe_times)
    quick = quickest(chords, limits, PERIOD)
    # The reserve to stop with costs up to 1.02 %.
    assert 0.0 < quick.duration / case["duration"] - 1.0 < 0.012
    # Times by a power of the distances make it hardly longer than times by the distances.
    assert alone(made(request.keyframes, limits)) < 1.01 * quick.duration


@pytest.mark.parametrize("jerk", [40.0, 80.0])
def test_what_is_drawn_between_the_records_hardly_ever_needs_a_second_timing(jerk):
    limits = Limits.partial(velocity=1.0, acceleration=4.0, jerk=jerk)
    beyond, slower = 0, []
    for seed in range(20):
        random = np.random.default_rng(seed)
        request = MotionRequest([Keyframe(q) for q in rotations(random, 12, 0.4)])
        job = PlanJob.of(request, State.at_rest(request.keys[0]), limits, PERIOD)
        knots, guess = job.knots(is_quick=True)
        quick = quickest(job.path(knots, guess), limits, PERIOD)
        whole = Path.joined([quick.trajectory], quick.positions)
        peaks = measure(
            whole,
            math.ceil(quick.duration / PERIOD) + 1,
            PERIOD,
            limits,
            before=before(State.at_rest(whole.first), PERIOD),
            tolerance=1.0,
        )
        beyond += max(peaks.drawn) > GUARD_TOLERANCE
        slower.append(quick.duration / float(quick.profile.clock().times[-1]))
    assert beyond <= 2
    # Nor need the pace be lower for what the records have as the path leaves rest.
    assert np.median(slower) < 1.0005


def test_a_path_at_the_quickest_pace_has_the_orientations_of_its_curve():
    random = np.random.default_rng(3)
    request = MotionRequest([Keyframe(q) for q in rotations(random, 5, 0.7)])
    job = PlanJob.of(request, State.at_rest(request.keys[0]), LIMITS["soft"], PERIOD)
    knots, guess = job.knots(is_quick=True)
    path = job.path(knots, guess)
    quick = quickest(path, LIMITS["soft"], PERIOD)
    clock, curve = quick.profile.clock(), path.trajectory
    t = np.sort(random.uniform(0.0, quick.duration, 2000))
    s, rate, change = clock(t * (clock.times[-1] / quick.duration))
    pace = clock.times[-1] / quick.duration
    q, omega, alpha = curve.sample(s)
    rate, change = (rate * pace)[:, None], (change * pace**2)[:, None]
    expected = q, omega * rate, alpha * rate**2 + omega * change
    for found, wanted in zip(quick.trajectory.sample(t), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=2e-7 * np.abs(wanted).max())


def test_a_stop_at_every_keyframe_takes_as_long_as_a_turn_to_each():
    q = [HERE, about_z(0.002)]
    q.append(tuple(multiply(np.array(q[1]), exp([0.0, 0.0, -0.6])).tolist()))
    motion, *turns = [
        made([Keyframe(key) for key in keys], LIMITS["arm"]) for keys in (q, q[:2], q[1:])
    ]
    assert any(note.startswith("stops at every keyframe") for note in motion.certificate.notes)
    assert motion.duration <= sum(turn.duration for turn in turns) * (1.0 + 1e-5)


def test_times_at_keyframes_are_chosen_the_same_way_at_any_share_of_the_pace():
    random = np.random.default_rng(7)
    keyframes = [Keyframe(q) for q in rotations(random, 6, 0.8)]
    start, limits = State.at_rest(keyframes[0].q), LIMITS["arm"]
    quick, again, slow, usual = (
        plan(MotionRequest(keyframes, pace=pace), start=start, limits=limits, period=PERIOD)
        for pace in (None, None, 0.6, "even")
    )
    np.testing.assert_array_equal(quick.rows(0, 100), again.rows(0, 100))
    assert slow.duration == pytest.approx(quick.duration / 0.6, rel=2e-3)
    assert quick.certificate.keyframe_error < 1e-9
    dense = quick.sample(np.linspace(0.0, quick.end_time, 20001)).q

    def distance(motion):
        q = motion.sample(np.linspace(0.0, motion.end_time, 50)).q
        return np.max(1.0 - np.abs(q @ dense.T).max(axis=1))

    assert distance(slow) < 1e-7
    assert distance(usual) > 1e-6


@pytest.mark.parametrize("name", sorted(LIMITS))
@pytest.mark.parametrize("seed", range(2))
def test_it_is_quicker_and_keeps_the_limits_on_what_is_sent(name, seed):
    limits, random = LIMITS[name], np.random.default_rng(seed)
    asked, start = random_request(random, limits), anywhere(random)
    fields = {
        key: getattr(asked, key)
        for key in ("start_velocity", "end_velocity", "velocity_frame", "approach")
    }
    usual = plan(even(asked), start=start, limits=limits, period=PERIOD)
    quick = made(asked.keyframes, limits, start=start, **fields)
    assert alone(quick) < 0.95 * alone(usual)
    rates = differences(quick.sample(times_of(quick)).q, PERIOD, start=start.q)
    for rate, limit in zip(rates, (limits.velocity, limits.acceleration, limits.jerk), strict=True):
        assert rate.max() <= limit * (1.0 + 1e-6)
    certificate = quick.certificate
    assert certificate.keyframe_error < 1e-9
    assert max(certificate.start_velocity_error, certificate.end_velocity_error) < 1e-9
    assert certificate.brake_rate > 0.0


@pytest.mark.parametrize("seed", range(2))
def test_it_passes_the_same_points_as_the_curve_at_its_own_pace(seed):
    random = np.random.default_rng(seed)
    asked = random_request(random, LIMITS["arm"], approach=False, start_velocity=None)
    start = State.at_rest(
        asked.keys[0], np.zeros(3) if asked.positions is None else asked.positions[0]
    )
    usual = plan(even(asked), start=start, limits=LIMITS["arm"], period=PERIOD)
    quick = made(
        asked.keyframes,
        LIMITS["arm"],
        start=start,
        end_velocity=asked.end_velocity,
        velocity_frame=asked.velocity_frame,
    )
    dense = usual.sample(np.linspace(0.0, usual.end_time, 20001))
    some = quick.sample(np.linspace(0.0, quick.end_time, 50))
    nearest = np.abs(some.q @ dense.q.T).argmax(axis=1)
    assert np.abs(np.abs(np.sum(some.q * dense.q[nearest], axis=1)) - 1.0).max() < 1e-7
    np.testing.assert_allclose(some.position, dense.position[nearest], atol=1e-3)


def test_records_are_exact_derivatives_of_one_another():
    random = np.random.default_rng(5)
    keyframes = [
        Keyframe(q, position=tuple(random.uniform(-0.1, 0.1, 3))) for q in rotations(random, 6, 0.8)
    ]
    motion = made(
        keyframes, LIMITS["soft"], start=State.at_rest(keyframes[0].q, keyframes[0].position)
    )
    t = random.uniform(0.01, motion.duration - 0.01, 400)
    h = 1e-5
    before, here, after = (motion.sample(t + shift) for shift in (-h, 0.0, h))
    from scipy.spatial.transform import Rotation

    q0, q1 = (Rotation.from_quat(part.q[:, [1, 2, 3, 0]]) for part in (before, after))
    omega = (q0.inv() * q1).as_rotvec() / (2 * h)
    np.testing.assert_allclose(here.omega_body, omega, atol=1e-6)
    alpha = (after.omega_body - before.omega_body) / (2 * h)
    np.testing.assert_allclose(here.alpha_body, alpha, atol=2e-3)
    velocity = (after.position - before.position) / (2 * h)
    np.testing.assert_allclose(here.velocity, velocity, atol=1e-6)


def test_a_curve_that_starts_with_an_acceleration_leaves_rest_without():
    still = {"start_velocity": (0.0, 0.0, 0.0), "end_velocity": (0.0, 0.0, 0.0)}
    keyframes = [Keyframe(HERE), Keyframe(about_z(0.7))]
    motion = made(keyframes, LIMITS["soft"], method="kks_hermite", **still)
    assert motion.start_time == 0.0
    first = motion.sample(np.array([0.0, 1e-3]))
    np.testing.assert_array_equal(first.omega_body[0], 0.0)
    assert np.linalg.norm(first.alpha_body[0]) == 0.0
    assert 0.0 < np.linalg.norm(first.alpha_body[1]) < 1.1e-3 * LIMITS["soft"].jerk


def test_limits_of_axes_make_the_pace_where_they_are_the_tighter_ones():
    turn = [Keyframe(HERE), Keyframe(about_z(2.0))]
    limits = DEFAULT_LIMITS.with_rates({"velocity": [2.5, 2.5, 1.0], "jerk": [9000, 9000, 200.0]})
    norm = DEFAULT_LIMITS.with_rates({"velocity": 1.0, "jerk": 200.0})
    assert alone(made(turn, limits)) == pytest.approx(alone(made(turn, norm)), rel=1e-3)


def test_it_takes_over_from_a_motion_that_is_still_moving():
    first = made([Keyframe(HERE), Keyframe(about_z(1.0))], LIMITS["soft"])
    moment = PERIOD * round(0.5 * first.end_time / PERIOD)
    start = first.path.state(moment)
    keys = [tuple(start.q), about_z(1.4), (math.cos(0.4), math.sin(0.4), 0.0, 0.0)]
    motion = made([Keyframe(q) for q in keys], LIMITS["soft"], start=start)
    here = motion.sample(np.array([0.0]))
    np.testing.assert_allclose(here.omega_body[0], start.omega_body, atol=1e-9)
    np.testing.assert_allclose(here.alpha_body[0], start.alpha_body, atol=1e-4)


def test_a_long_motion_can_be_stopped_on_what_is_read_ahead():
    random = np.random.default_rng(1)
    motion = made([Keyframe(q) for q in rotations(random, 12, 0.9)], LIMITS["slow"])
    assert motion.duration > 6.0
    assert motion.certificate.stop_time <= 6.0


def test_a_curve_of_an_odd_shape_is_planned_nevertheless():
    keys = (
        (-0.2527743801661137, -0.8973777927437618, 0.13831851207623608, 0.3341948519037767),
        (-0.49459002641212535, -0.7428372871951204, 0.21681470844827389, 0.3956827677909883),
    )
    request = MotionRequest([Keyframe(q) for q in keys], method="squad", approach=True)
    motion = plan(request, start=State.at_rest(keys[0]), limits=LIMITS["soft"], period=PERIOD)
    usual = plan(even(request), start=State.at_rest(keys[0]), limits=LIMITS["soft"], period=PERIOD)
    assert motion.duration <= usual.duration


@pytest.mark.parametrize(
    ("turn", "first", "last", "acceleration", "jerk", "took"),
    [
        ([-0.002, -0.001, 0.001], [0.3, 0.46, -0.82], [-0.25, 0.89, 0.31], 76.0, 260.0, 0.3363),
        ([-0.114, 0.025, -0.001], [-0.75, 0.63, 0.05], [-0.64, -0.62, -0.34], 53.0, 540.0, 0.1579),
        ([-0.041, -0.024, -0.023], [-0.83, 0.51, 0.07], [0.26, -0.94, 0.08], 79.0, 1920.0, 0.0909),
    ],
)
def test_a_curve_between_ends_near_their_limit_has_a_quickest_timing(
    turn, first, last, acceleration, jerk, took
):
    rates = {"velocity": 1.0, "acceleration": acceleration, "jerk": jerk}
    motion = plan(
        MotionRequest(
            [Keyframe(HERE), Keyframe(tuple(exp(turn).tolist()))],
            method="kks_interpolating",
            start_velocity=first,
            end_velocity=last,
            approach=True,
        ),
        start=State.at_rest(HERE),
        limits=DEFAULT_LIMITS.with_rates(rates),
        period=PERIOD,
    )
    assert alone(motion) == pytest.approx(took, rel=0.01)


def test_a_curve_that_nearly_rests_at_keyframes_close_together_is_planned():
    keys = [HERE]
    for turn in ([2.1, -2.1, 0.9], [8e-6, 0.0, 0.0], [3e-6, 0.0, 2e-6]):
        keys.append(tuple(multiply(keys[-1], exp(turn)).tolist()))
    limits = DEFAULT_LIMITS.with_rates({"velocity": 1.2, "acceleration": 60.0, "jerk": 1e7})
    motion = made([Keyframe(q) for q in keys], limits, method="minimum_effort")
    assert motion.duration < 4.0


def test_times_and_a_minimum_duration_are_refused_together():
    with pytest.raises(RequestError, match="the planner then chooses the times") as caught:
        MotionRequest([Keyframe(HERE, 0.0), Keyframe(about_z(1.0), 1.0)], duration="minimum")
    assert caught.value.field == "duration"
    with pytest.raises(RequestError, match="expected 'minimum' or seconds, got the text 'least'"):
        MotionRequest([Keyframe(HERE), Keyframe(about_z(1.0))], duration="least")
