"""Laws of every motion, over random requests, limits and rates."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from planned import LIMITS, PERIOD, differences, random_motions, times_of

from orientd.driver import ZERO
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner.planning import plan
from orientd.rotation import angle, conjugate, rotate
from orientd.servo.guard import Guard
from orientd.stream.records import ServoLimits

TOLERANCE = 1.0 + 1e-6


@pytest.fixture(scope="module", params=sorted(LIMITS))
def motions(request):
    return random_motions(sum(map(ord, request.param)), 12, LIMITS[request.param])


def test_backward_differences_of_the_records_keep_the_limits(motions):
    for motion in motions:
        q = motion.records(0, motion.record_count)[:, :4]
        velocity, acceleration, jerk = differences(q, PERIOD)
        assert velocity.max() <= motion.limits.velocity * TOLERANCE
        assert acceleration.max() <= motion.limits.acceleration * TOLERANCE
        assert jerk.max() <= motion.limits.jerk * TOLERANCE


def test_the_certificate_tells_the_peaks_of_the_records(motions):
    for motion in motions:
        certificate = motion.certificate
        found = differences(motion.sample(times_of(motion)).q, PERIOD)
        for rates, peak, digits in zip(
            found,
            (certificate.peak_velocity, certificate.peak_acceleration, certificate.peak_jerk),
            (1e-9, 1e-6, 1e-3),
            strict=True,
        ):
            assert peak.on_records == pytest.approx(rates.max(), rel=1e-6, abs=digits)
            assert peak.value >= peak.on_records


def test_the_servos_guard_lets_every_record_pass(motions):
    motion = max(motions, key=lambda m: m.certificate.peak_acceleration.ratio)
    limits = motion.limits
    terms = ServoLimits(
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        limits.linear_velocity,
        limits.linear_acceleration,
        motion.certificate.brake_rate,
    )
    guard = Guard(PERIOD)
    records = motion.records(0, motion.record_count)
    guard.anchor(tuple(records[0, :4].tolist()), tuple(records[0, 10:13].tolist()))
    for record in [*records.tolist(), *records[-1:].tolist() * 3]:
        assert guard.admit(tuple(record[:4]), tuple(record[10:13]), terms) == ""
    assert guard.velocity == ZERO


def test_end_velocities_are_exact(motions):
    for motion in motions:
        request = motion.request
        for wanted, time, key in (
            (request.start_velocity, motion.start_time, request.keys[0]),
            (request.end_velocity, motion.end_time, request.keys[-1]),
        ):
            if wanted is None:
                continue
            sent = motion.sample([time]).omega_body[0]
            body = np.array(wanted)
            if request.velocity_frame == "world":
                body = rotate(conjugate(key), body)
            assert sent == pytest.approx(body, abs=1e-9)
        assert motion.certificate.start_velocity_error < 1e-9
        assert motion.certificate.end_velocity_error < 1e-9


def test_keyframes_are_met(motions):
    for motion in motions:
        error = angle(motion.sample(motion.keyframe_times).q, motion.request.keys)
        assert error.max() < 1e-9
        assert motion.certificate.keyframe_error < 1e-9


def test_positions_are_met_at_their_keyframes(motions):
    for motion in motions:
        if motion.request.positions is not None:
            met = motion.sample(motion.keyframe_times).position
            assert met == pytest.approx(motion.request.positions, abs=1e-9)


def test_acceleration_is_continuous_from_hold_to_hold(motions):
    moment = 1e-9
    for motion in motions:
        joins = {0.0, motion.duration, *motion.path.trajectory.knots.tolist()}
        joins |= set(motion.keyframe_times.tolist())
        times = np.array(sorted(joins))
        before, after = motion.sample(times - moment), motion.sample(times + moment)
        peak = motion.certificate.peak_acceleration.value
        # Within two moments the acceleration changes with the jerk.
        change = 2.0 * moment * 3.0 * motion.limits.jerk
        step = np.linalg.norm(after.alpha_body - before.alpha_body, axis=1)
        assert step.max() <= 1e-6 * peak + change
        step = np.linalg.norm(after.omega_body - before.omega_body, axis=1)
        assert step.max() <= 4.0 * moment * motion.limits.acceleration + 1e-12
        assert angle(before.q, after.q).max() <= 4.0 * moment * motion.limits.velocity + 1e-12


def test_quaternions_are_continuous_with_their_signs(motions):
    for motion in motions:
        q = motion.sample(times_of(motion)).q
        assert np.einsum("ij,ij->i", q[1:], q[:-1]).min() > 0.99
        assert np.abs(np.linalg.norm(q, axis=1) - 1.0).max() < 1e-12


def test_velocity_and_acceleration_are_the_derivatives_of_the_orientation(motions):
    h = 1e-5
    for motion in motions:
        times = np.random.default_rng(5).uniform(2 * h, motion.duration - 2 * h, 200)
        q = [motion.sample(times + shift * h).q for shift in (-1, 0, 1)]
        here = motion.sample(times)
        derivative = (q[2] - q[0]) / (2 * h)
        w = 2.0 * np.stack(
            [_product(_conjugate(a), b) for a, b in zip(q[1], derivative, strict=True)]
        )
        assert w[:, 1:] == pytest.approx(here.omega_body, abs=1e-6 * motion.limits.jerk)
        faster, slower = (motion.sample(times + s * h).omega_body for s in (1, -1))
        assert (faster - slower) / (2 * h) == pytest.approx(
            here.alpha_body, abs=4 * h * motion.limits.jerk
        )


def _conjugate(q):
    return q * [1, -1, -1, -1]


def _product(p, q):
    w, v = p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([w, *v])


def test_the_first_keyframe_falls_on_a_record(motions):
    for motion in motions:
        records = motion.start_time / PERIOD
        assert records == pytest.approx(round(records), abs=1e-9)


def test_the_last_record_rests_where_the_motion_ends(motions):
    for motion in motions:
        last = motion.records(motion.record_count - 1, 1)[0]
        assert last[:4] == pytest.approx(motion.path.last, abs=0)
        assert not np.any(last[4:10])
        assert not np.any(last[13:16])
        assert np.all(np.isnan(last[16:]))  # no joints
        assert (motion.record_count - 1) * PERIOD >= motion.duration - 1e-9
        assert (motion.record_count - 2) * PERIOD < motion.duration


def test_planned_timings_keep_something_to_brake_with(motions):
    for motion in motions:
        if motion.request.times is None:
            assert motion.certificate.brake_rate > 0.0
            assert motion.certificate.stop_time <= 6.0


def test_an_even_pace_keeps_a_reserve_to_brake_with(motions):
    for motion in motions[::6]:
        request = MotionRequest(**{**motion.request.given(), "pace": "even"})
        start = motion.path.state(0.0)
        motion = plan(request, start=start, limits=motion.limits, period=PERIOD)
        assert motion.certificate.peak_acceleration.ratio <= 0.97


def test_planned_timings_are_as_short_as_the_limits_allow(motions):
    # Something is at its limit, or at its share of it, somewhere between first and last keyframe.
    for motion in motions:
        if motion.request.times is None and not motion.certificate.notes:
            c = motion.certificate
            used = max(
                c.peak_velocity.ratio,
                c.peak_acceleration.ratio,
                c.peak_jerk.ratio,
                c.peak_linear_velocity.ratio,
                c.peak_linear_acceleration.ratio,
            )
            assert used > 0.97


@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(
    seed=st.integers(0, 10**6),
    velocity=st.floats(0.1, 8.0),
    stiffness=st.floats(2.0, 30.0),
    snap=st.floats(8.0, 500.0),
    period=st.sampled_from([0.001, 0.002, 0.004, 1.0 / 125.0, 1.0 / 300.0]),
)
def test_limits_are_kept_whatever_they_are(seed, velocity, stiffness, snap, period):
    acceleration = stiffness * velocity
    jerk = snap * acceleration
    limits = Limits(velocity, acceleration, jerk, 0.7, 4.0)
    for motion in random_motions(seed, 2, limits, period=period):
        found = differences(motion.records(0, motion.record_count)[:, :4], period)
        for rates, limit in zip(found, (velocity, acceleration, jerk), strict=True):
            assert rates.max() <= limit * TOLERANCE + 1e-12 / period**3
