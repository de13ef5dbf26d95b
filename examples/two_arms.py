"""Two devices that start at the same instant.  First: orientd run --config two_arms.toml."""

import time

from scipy.spatial.transform import Rotation

import orientd

TURN = [Rotation.from_euler("z", 40, degrees=True)]

with orientd.connect() as robot:
    start = time.time() + 3.0
    motions = [robot.move(TURN, device=name, start_time=start) for name in ("left", "right")]
    for motion in motions:
        summary = motion.wait()
        is_together = summary.start_skew < 0.01
        print(f"{orientd.word(summary, 'outcome')}, apart by less than 10 ms: {is_together}")
