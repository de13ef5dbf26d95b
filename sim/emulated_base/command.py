"""Print the samples of a base as lines of JSON, in real time."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time

from emulated_base.imu import Imu
from emulated_base.motion import BaseMotion


def run(motion: BaseMotion, imu: Imu, *, seconds: float = math.inf) -> None:
    """Print samples until some seconds have passed, Ctrl-C, or until no program reads them.

    The time of a line is that of the measurement, on the monotonic clock of this machine.
    """
    begin_ns = time.monotonic_ns()
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        for sample in imu.samples(motion):
            if sample.time >= seconds:
                break
            time.sleep(max(0.0, sample.arrives - (time.monotonic_ns() - begin_ns) * 1e-9))
            line = {
                "base": {"quaternion": dict(zip("wxyz", sample.q_world_base, strict=True))},
                "angular_velocity": sample.omega_base,
                "time_ns": begin_ns + round(sample.time * 1e9),
            }
            sys.stdout.write(json.dumps(line) + "\n")
            sys.stdout.flush()
