"""What it costs to import the curves and take the first samples: prints ms and MiB."""

import json
import time
from pathlib import Path

import numpy as np
import scipy.interpolate
import scipy.linalg
import scipy.spatial.transform  # noqa: F401 - what is measured comes on top of it


def resident_mib():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


before, began = resident_mib(), time.process_time()

from orientd.curves import METHODS  # noqa: E402 - this is what is measured

curve = METHODS["c2_cumulative"](keys=np.eye(4), times=np.arange(4.0))
curve.evaluate(np.linspace(0.0, 3.0, 1000))
print(json.dumps([1e3 * (time.process_time() - began), resident_mib() - before]))
