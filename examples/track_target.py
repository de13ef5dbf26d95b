"""Follow a moving target, and say how far behind the device was.  First: orientd run."""

import math
import time

from scipy.spatial.transform import Rotation

import orientd

SECONDS, RATE = 3.0, 100.0  # of the stream

with orientd.connect() as robot:
    device = robot.devices()[0].name
    with robot.track(device=device) as tracking:
        begin = time.monotonic()
        while (t := time.monotonic() - begin) < SECONDS:
            target = Rotation.from_rotvec([0.0, 0.3 * math.sin(t), 0.5 * math.sin(0.7 * t)])
            ahead = Rotation.from_rotvec(
                [0.0, 0.3 * math.sin(t + 1e-4), 0.5 * math.sin(0.7 * (t + 1e-4))]
            )
            omega_body = (target.inv() * ahead).as_rotvec() / 1e-4
            tracking.aim(target, angular_velocity=omega_body, time_to_live=0.2)
            time.sleep(1.0 / RATE)
        report = tracking.report
    print(f"{report.targets} targets, at the end {math.degrees(report.error):.2f} degrees away")
