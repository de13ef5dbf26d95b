"""A motion's certificate says of it what its own records, state and request say."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from planned import LIMITS, PERIOD, times_of

from orientd.errors import LimitError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify import summary as summing_up
from orientd.planner.certify.measuring import measure
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp

ARM = LIMITS["arm"]
AXES = ARM.with_rates({"velocity": [0.9, math.inf, 0.8], "jerk": [math.inf, 5000.0, math.inf]})
WAY = [(0.0, 0.0, 0.0), (0.0, 0.2, 0.1), (0.1, 0.3, 0.4), (0.2, 0.3, 0.5)]
HERE = State.at_rest((1.0, 0.0, 0.0, 0.0))


def asked(times=None, **fields):
    times = [None] * len(WAY) if times is None else times
    keys = [tuple(exp(np.array(vector))) for vector in WAY]
    return MotionRequest([Keyframe(q, t) for q, t in zip(keys, times, strict=True)], **fields)


def made(request, *, start=HERE, limits=ARM):
    return plan(request, start=start, limits=limits, period=PERIOD)


def test_a_certificate_tells_the_motion_it_is_of():
    # At an even pace each rate is at its largest once, and not for a while.
    ends = {"start_velocity": (0.1, 0.2, 0.3), "end_velocity": (0.0, 0.1, 0.2)}
    request = asked(**ends, approach=True, pace="even")
    motion = made(request, limits=AXES)
    certificate = motion.certificate
    assert certificate.rate_hz == pytest.approx(500.0)
    assert certificate.duration == motion.duration == pytest.approx(motion.path.duration)
    assert 0.0 < certificate.lead_in == motion.start_time
    assert 0.0 < certificate.lead_out == pytest.approx(motion.duration - motion.end_time)
    assert (certificate.start_velocity_error, certificate.end_velocity_error) == pytest.approx(
        (0.0, 0.0), abs=1e-9
    )
    assert certificate.brake_rate > 0.0
    assert certificate.stop_time == min(1.0 / certificate.brake_rate, motion.duration)
    assert certificate.notes == ()
    names = [figure.name for figure in certificate.figures]
    assert names == [
        "angular velocity about x",
        "angular velocity about z",
        "angular jerk about y",
    ]
    assert [figure.limit for figure in certificate.figures] == [0.9, 0.8, 5000.0]
    assert [figure.unit for figure in certificate.figures] == ["rad/s", "rad/s", "rad/s^3"]
    q = motion.sample(times_of(motion)).q
    rates = np.abs(angle_rates(q))
    for figure, axis in zip(certificate.figures[:2], (0, 2), strict=True):
        # Somewhat more between the records than on them.
        assert rates[:, axis].max() * (1 - 1e-6) <= figure.value <= 1.01 * rates[:, axis].max()
        time = (np.argmax(rates[:, axis]) + 1) * PERIOD
        assert figure.time == pytest.approx(time, abs=1.01 * PERIOD)


def angle_rates(q):
    from orientd.rotation import conjugate, log, multiply

    return log(multiply(conjugate(q[:-1]), q[1:])) / PERIOD


def test_errors_are_how_far_the_path_is_from_what_was_asked():
    motion = made(asked([0.0, 1.0, 2.0, 3.0]))
    request, path, certificate = motion.request, motion.path, motion.certificate
    begin, end = motion.start_time, motion.end_time
    assert (certificate.start_velocity_error, certificate.end_velocity_error) == (0.0, 0.0)
    other = replace(request, start_velocity=(0.3, 0.0, 0.4), end_velocity=(0.0, 0.6, 0.8))
    peaks = Mock(
        brake_rate=0.0,
        usual_stop_time=0.1,
        unproven=0,
        axis_velocity=(),
        axis_acceleration=(),
        axis_jerk=(),
    )
    peaks.velocity = certificate.peak_velocity
    later = motion.keyframe_times + np.array([0.0, 0.0, 0.1, 0.0])
    found = summing_up.summed_up(other, path, (begin, end), later, peaks, PERIOD)
    for time, wanted, error in (
        (begin, (0.3, 0.0, 0.4), found.start_velocity_error),
        (end, (0.0, 0.6, 0.8), found.end_velocity_error),
    ):
        assert error == pytest.approx(np.linalg.norm(path.state(time).omega_body - wanted))
    missed = angle(motion.sample(later).q, request.keys).max()
    assert found.keyframe_error == pytest.approx(missed, rel=1e-9)
    assert found.keyframe_error > 0.01
    assert found.stop_time == math.inf
    peaks.brake_rate = 0.5
    slow = summing_up.summed_up(other, path, (begin, end), later, peaks, PERIOD)
    assert slow.stop_time == 2.0
    assert found.figures == ()


def measured_path(path, count, before):
    return measure(path, count, PERIOD, ARM, before=before, tolerance=1.0)


def test_a_path_that_is_broken_off_is_measured_with_the_stop():
    motion = made(asked())
    path, count = motion.path, motion.record_count // 2
    assert measured_path(path, count, None).acceleration.time == pytest.approx(count * PERIOD)


def test_a_device_that_is_not_where_a_path_begins_is_measured_with_the_jump():
    motion = made(asked())
    before = np.tile(HERE.q, (3, 1)), np.tile([0.2, 0.3, 0.6], (3, 1))
    peak = measured_path(motion.path, motion.record_count, before).linear_velocity
    assert (peak.on_records, peak.time) == (pytest.approx(0.7 / PERIOD), 0.0)
    assert peak.on_records <= peak.value <= 1.0004 * peak.on_records


def test_a_certificate_tells_the_peaks_of_a_position():
    q = tuple(HERE.q.tolist())
    keys = [Keyframe(q, 0.0, position=(0.0, 0.0, 0.0)), Keyframe(q, 1.0, position=(0.1, 0.2, 0.2))]
    certificate = made(MotionRequest(keys)).certificate
    assert certificate.peak_linear_velocity.value == pytest.approx(1.875 * 0.3, rel=1e-4)
    assert certificate.peak_linear_velocity.time == pytest.approx(0.5, abs=1.5 * PERIOD)
    most = 10.0 / math.sqrt(3.0) * 0.3
    assert certificate.peak_linear_acceleration.value == pytest.approx(most, rel=1e-4)


@pytest.mark.parametrize(
    ("duration", "records"), [(3.0, 1501), (3.0005, 1502), (3.0 * 1.1, 1651), (3.0019, 1502)]
)
def test_the_last_record_is_at_the_end_or_within_a_period_behind_it(duration, records):
    motion = made(asked([0.0, 1.0, 2.0, duration]))
    assert motion.record_count == records
    assert motion.duration == duration


def test_the_past_of_a_steady_motion_is_carried_back():
    omega, alpha = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -3.0])
    velocity, push = np.array([0.3, 0.2, 0.1]), np.array([-1.0, 0.0, 4.0])
    start = State(HERE.q, omega, alpha, np.array([1.0, 2.0, 3.0]), velocity, push)
    q, p = summing_up.before(start, PERIOD)
    for k in range(3):
        t = (k - 3) * PERIOD
        np.testing.assert_allclose(q[k], exp(omega * t + alpha * t * t / 2), atol=1e-12)
        np.testing.assert_allclose(p[k], [1, 2, 3] + velocity * t + push * t * t / 2, atol=1e-12)
    known = replace(start, before=(q[::-1], p))
    assert summing_up.before(known, PERIOD) is known.before


def test_what_breaks_a_limit_gets_no_certificate():
    with pytest.raises(LimitError, match="angular velocity reaches"):
        made(asked([0.0, 0.1, 0.2, 0.3]), limits=Limits.partial(velocity=0.5))


def test_a_motion_is_what_was_drafted():
    request = asked(method="kks_hermite_spline", end_velocity=(0.0, 0.1, 0.0), approach=True)
    motion = plan(request, start=HERE, limits=ARM, period=PERIOD)
    assert motion.request is request
    assert motion.limits == ARM
    assert motion.period == PERIOD
    assert angle(motion.sample(motion.keyframe_times).q, request.keys).max() < 1e-9
    assert (motion.start_time, motion.end_time) == (
        motion.keyframe_times[0],
        motion.keyframe_times[-1],
    )
