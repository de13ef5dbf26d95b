"""What works without a package that only some users install."""

import subprocess
import sys

WITHOUT_SCIPY = """
import sys
sys.modules["scipy"] = None
"""

PLAN = """
import orientd
from orientd.curves import METHODS, fit_orientations
from orientd.errors import OrientdError

keys = [[1, 0, 0, 0], [0.8, 0.6, 0, 0], [0.8, 0, 0.6, 0], [0.6, 0, 0, 0.8]]
for name in ("nielson_shieh", "spherical_quadratic", "minimum_effort", "c2_cumulative"):
    curve = METHODS[name](keys=keys, times=[0.0, 1.0, 2.0, 3.5])
    q = curve.evaluate([0.5, 3.0])[0]
keys = [orientd.Quaternion(w=1, x=0, y=0, z=0), orientd.Quaternion(w=0.8, x=0, y=0, z=0.6)]
assert orientd.plan(keys).certificate
times = [0.1 * step for step in range(40)]
fit_orientations(times, curve.evaluate([0.08 * step for step in range(40)])[0])
try:
    curve(0.5)
except OrientdError as error:
    print(error)
"""


def printed(program):
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_curves_plans_and_fits_need_no_scipy_and_a_rotation_says_what_to_install():
    assert "pip install 'orientd-motion[scipy]'" in printed(WITHOUT_SCIPY + PLAN)
