"""Setpoints at the driver of a real daemon, compared with the request."""

import numpy as np
import pytest
from harness import DaemonProcess, assert_limits_kept, peaks, spin

from orientd import rotation
from orientd.motion_file import loads
from orientd.protocol import control_pb2 as pb
from orientd_loopback import read_recording

pytestmark = pytest.mark.world


def five_point(q, k, period):
    """Return the body velocity at sample *k* from its four neighbours, of fourth order."""
    turns = [
        rotation.log(rotation.multiply(rotation.conjugate(q[k]), q[k + j])) for j in range(-2, 3)
    ]
    return (turns[0] - 8 * turns[1] + 8 * turns[3] - turns[4]) / (12 * period)


@pytest.fixture(scope="module", params=[500.0, 1000.0])
def streamed(request, tmp_path_factory):
    """A motion with velocity at both ends, as it was planned and as the driver recorded it."""
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), rate_hz=request.param) as daemon:
        motion = spin(2.4, start=(0.1, -0.2, 0.4), end=(0.3, 0.2, -0.5))
        for _ in range(8):
            begun = len(read_recording(daemon.recording))
            *_, last = daemon.move(motion)
            # Setpoints are counted here: late cycles leave none out, and a stall adds others.
            if last.summary.outcome == pb.OUTCOME_DONE and not last.summary.statistics.stalls:
                break
        assert last.summary.outcome == pb.OUTCOME_DONE
        sent = read_recording(daemon.recording)[begun:]
    first = next(k for k, s in enumerate(sent) if s.q != sent[0].q) - 1
    return loads(motion), daemon.started.plan, sent[first:], daemon.period, last.summary


def test_end_velocities_are_met_at_their_instants(streamed):
    motion, plan, sent, period, summary = streamed
    q = np.array([setpoint.q for setpoint in sent])
    for time, wanted in (
        (plan.start_time, motion.start_velocity),
        (plan.end_time, motion.end_velocity),
    ):
        k = round(time / period)
        assert abs(k * period - time) < 1e-9  # both instants fall on a cycle here
        np.testing.assert_allclose(sent[k].omega_body, wanted, atol=1e-6)
        # The orientations themselves turn at that rate; across the joint the jerk has a step.
        np.testing.assert_allclose(five_point(q, k, period), wanted, atol=2e-3)
    assert summary.statistics.start_velocity_error < 1e-6
    assert summary.statistics.end_velocity_error < 1e-6


def test_keyframes_are_met_at_their_times(streamed):
    motion, plan, sent, period, _ = streamed
    for time, keyframe in zip(plan.keyframe_times, motion.keyframes, strict=True):
        k = round(time / period)
        assert abs(k * period - time) < 1e-9
        assert rotation.angle(np.array(sent[k].q), np.array(keyframe.q)) < 1e-9


def test_what_is_sent_is_what_was_certified(streamed):
    _, plan, sent, period, summary = streamed
    q = np.array([setpoint.q for setpoint in sent])
    assert_limits_kept(q, period)
    found = peaks(q, period)
    certificate, measured = plan.certificate, summary.statistics
    certified = (
        certificate.peak_velocity,
        certificate.peak_acceleration,
        certificate.peak_jerk,
    )
    for value, peak in zip(found, certified, strict=True):
        assert value == pytest.approx(peak.on_records, rel=1e-6)
        assert value <= peak.value * (1 + 1e-6)
    assert found == pytest.approx(
        (measured.velocity, measured.acceleration, measured.jerk), rel=1e-6
    )


def test_acceleration_is_continuous_from_hold_to_hold(streamed):
    _, plan, sent, period, _ = streamed
    alpha = np.array([setpoint.alpha_body for setpoint in sent])
    assert np.linalg.norm(alpha[0]) == 0.0
    assert np.linalg.norm(alpha[-1]) == 0.0
    steps = np.linalg.norm(np.diff(alpha, axis=0), axis=1)
    # A step of the acceleration would be larger by orders than what the jerk makes of a period.
    assert steps.max() <= 1.5 * plan.certificate.peak_jerk.value * period
