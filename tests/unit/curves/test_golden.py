"""Every family against reference curves computed with 51 digits (tests/data/golden)."""

import json
from pathlib import Path

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.rotation import angle

GOLDEN = Path(__file__).parents[2] / "data" / "golden"
CASES = {path.stem: json.loads(path.read_text()) for path in sorted(GOLDEN.glob("*.json"))}
ORDER = {"C0": 0, "C0,G1": 0, "C1": 1, "C2": 2, "C3": 2, "Cinf(single segment)": 2}


@pytest.fixture(params=CASES)
def case(request):
    found = CASES[request.param]
    if found["family"] not in METHODS:
        pytest.fail(f"no family {found['family']!r} in METHODS")
    return found


def test_samples_are_within_the_reference_tolerance(case):
    q, omega, alpha = METHODS[case["family"]](**case["params"]).evaluate(case["t"])
    tolerance = case["tolerance"]
    assert angle(q, case["q"]).max() <= tolerance["angle"]
    assert np.abs(omega - case["omega"]).max() <= tolerance["omega"]
    assert np.abs(alpha - case["alpha"]).max() <= tolerance["alpha"]


def test_limits_from_both_sides_of_inner_knots_are_the_reference_ones(case):
    curve = METHODS[case["family"]](**case["params"])
    tolerance = case["tolerance"]
    for knot in case.get("knots") or []:
        # A knot that is a sum of rounded intervals may be a few units off on either side.
        t = np.array([knot["t"] - 1e-13 * max(1.0, knot["t"]), knot["t"] + 1e-13])
        q, omega, alpha = curve.evaluate(t)
        assert angle(q, knot["q"]).max() <= tolerance["angle"]
        for side, left_right in enumerate(("left", "right")):
            assert np.abs(omega[side] - knot[f"omega_{left_right}"]).max() <= tolerance["omega"]
            assert np.abs(alpha[side] - knot[f"alpha_{left_right}"]).max() <= tolerance["alpha"]


def test_declared_continuity_is_the_measured_one(case):
    curve = METHODS[case["family"]](**case["params"])
    assert curve.continuity == ORDER[case["continuity"]]
    assert curve.domain == pytest.approx((case["t"][0], case["t"][-1]), rel=1e-15)
