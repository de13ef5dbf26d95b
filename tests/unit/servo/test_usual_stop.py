"""How long a stop usually takes is what the servo takes."""

import os

import numpy as np
from rides import LIMITS, SOME_METHODS, Ride, Track, random_motion

CASES = int(os.environ.get("ORIENTD_CASES", "8"))


def test_the_usual_time_of_a_stop_is_what_the_servo_takes():
    random, ratios = np.random.default_rng(21), []
    while len(ratios) < CASES:
        pace = None if random.random() < 0.7 else "even"
        limits = LIMITS[int(random.integers(len(LIMITS)))]
        motion = random_motion(random, limits, SOME_METHODS, pace)
        if motion is None or motion.record_count > 15_000:
            continue
        track = Track(motion)
        records = np.linspace(3, motion.record_count - 4, 16).astype(int)
        took = [Ride(track, record).stop() * motion.period for record in records.tolist()]
        usual = motion.certificate.usual_stop_time
        assert usual <= motion.certificate.stop_time
        # A few cycles more are for the jerk of the first and the last.
        assert max(took) < 1.6 * usual + 4 * motion.period
        ratios.append(max(took) / usual)
    assert 0.85 < np.median(ratios) < 1.15
    print(f"{CASES} motions: {np.percentile(ratios, [0, 50, 95, 100]).round(2).tolist()}")
