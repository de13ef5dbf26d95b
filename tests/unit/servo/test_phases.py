"""Setpoints between the records, after a pause or another speed, and their certificate."""

from itertools import pairwise

import numpy as np
import pytest
from rides import LIMITS, SOME_METHODS, Ride, Track, motions
from scipy.spatial.transform import Rotation

from orientd.errors import OrientdError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State as PlannedState
from orientd.servo.path.segment import Segment, point_of
from orientd.tolerances import GUARD_TOLERANCE

NAMES = ("velocity", "acceleration", "jerk")


def some_motions(seed, count, period):
    """Yield motions of all kinds of timing for a device of a period."""
    random, found = np.random.default_rng(seed), 0
    while found < count:
        steps = Rotation.from_rotvec(random.normal(size=(4, 3)) * random.uniform(0.05, 0.8))
        rotations = [Rotation.identity()]
        for step in steps[1 : int(random.integers(2, 5))]:
            rotations.append(rotations[-1] * step)
        is_minimum = random.random() < 0.4
        keys = [Keyframe(tuple(r.as_quat(scalar_first=True).tolist())) for r in rotations]
        request = MotionRequest(
            keys if random.random() < 0.8 else keys[-1:],
            method="c2_cumulative" if is_minimum else str(random.choice(SOME_METHODS)),
            approach=True,
            duration="minimum" if is_minimum else None,
        )
        start = PlannedState.at_rest((1.0, 0.0, 0.0, 0.0))
        limits = LIMITS[found % len(LIMITS)]
        try:
            motion = plan(request, start=start, limits=limits, period=period)
        except OrientdError:
            continue
        if motion.record_count < 800:
            found += 1
            yield motion


def drawn(motion, phase):
    """Return what the servo sends from hold to hold if its first cycle is a share of one."""
    points = [point_of((0, *row)) for row in motion.records(0, motion.record_count).tolist()]
    q = [Segment(a, b, motion.period).at(phase).q for a, b in pairwise(points)]
    return np.array([points[0].q] * 3 + q + [points[-1].q] * 3)


def largest(q, period):
    """Return the largest velocity, acceleration and jerk, as SciPy sees them."""
    rotations = Rotation.from_quat(q, scalar_first=True)
    rates = (rotations[:-1].inv() * rotations[1:]).as_rotvec() / period
    found = []
    for _ in NAMES:
        found.append(np.linalg.norm(rates, axis=1).max())
        rates = np.diff(rates, axis=0) / period
    return found


@pytest.mark.parametrize("period", [0.01, 0.004])
def test_a_certificate_holds_at_every_phase_between_two_cycles(period):
    shares = []
    for motion in some_motions(7, 10, period):
        peaks = [getattr(motion.certificate, f"peak_{name}") for name in NAMES]
        planned = [peak.on_records for peak in peaks]
        for phase in (0.125, 0.3, 0.5, 0.8):
            found = largest(drawn(motion, phase), period)
            for value, peak in zip(found, peaks, strict=True):
                assert value <= peak.limit * GUARD_TOLERANCE * 1.0005
                assert value <= peak.value * (1.0 + 1e-6)
            shares.append(max(np.divide(found, planned)))
    assert max(shares) > 1.02  # which the records alone do not tell


def test_no_stop_at_full_speed_takes_longer_than_certified():
    is_short, random = 0, np.random.default_rng(3)
    for kind in ("reserve", "minimum"):
        for motion in motions([8, len(kind)], 4, kind):
            track, stop_time = Track(motion), motion.certificate.stop_time
            is_short += stop_time < 0.999 / motion.certificate.brake_rate
            for record in random.integers(3, motion.record_count - 3, 3).tolist():
                ride = Ride(track, record)
                assert ride.stop() * motion.period <= stop_time + 2 * motion.period
                break
    assert is_short
