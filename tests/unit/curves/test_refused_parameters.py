"""Parameters that a family of curves refuses: each by its name, with what was expected."""

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.rotation import exp

KEYS = exp(np.cumsum([[0.1, 0.0, 0.3], [0.4, -0.5, 0.6], [-0.2, 0.7, 0.1]], axis=0))
FIVE = exp(np.cumsum(np.random.default_rng(5).normal(scale=0.6, size=(5, 3)), axis=0))
END = [0.0, 0.0, 1.0]


def same(first, second, keys=FIVE, sign=-1.0):
    """Return keyframes of which two are the same orientation."""
    changed = keys.copy()
    changed[second] = sign * changed[first]
    return {"keys": changed}


REFUSED = [
    # Of every family with conditions at its ends
    *(
        (name, given, problem)
        for name in ("rotation_vector_spline", "min_acceleration", "kks_interpolating")
        for given, problem in (
            ({"start": "clamped"}, "omega_start must be given"),
            ({"end": "clamped"}, "omega_end must be given"),
            ({"omega_start": END}, "omega_start must be None"),
            ({"start": "loose"}, "start must be one of 'natural', 'clamped', got 'loose'"),
            ({"end": "clamped", "omega_end": [0, 1]}, "omega_end must be a vector of 3"),
        )
    ),
    (
        "c2_cumulative",
        {"start": "free"},
        "must be one of 'natural', 'clamped', 'state', got 'free'",
    ),
    ("c2_cumulative", {"end": 3}, "end must be one of"),
    ("c2_cumulative", {"start": "clamped"}, "omega_start must be given for start='clamped', got N"),
    (
        "c2_cumulative",
        {"end": "state", "omega_end": END},
        "alpha_end must be given for end='state'",
    ),
    ("c2_cumulative", {"omega_start": END}, "omega_start must be None with start='natural'"),
    ("c2_cumulative", {"alpha_end": END}, "alpha_end must be None .* use end='state'"),
    (
        "c2_cumulative",
        {"start": "clamped", "omega_start": [1, 0]},
        "omega_start must be a vector of",
    ),
    (
        "c2_cumulative",
        {"start": "clamped", "omega_start": [1, 0, np.inf]},
        "omega_start must be a vector of 3",
    ),
    # Keyframes, times and whole turns
    ("c2_cumulative", {"align": 1}, "align must be True or False"),
    ("c2_cumulative", {"times": "equal"}, "times must be one of 'uniform', 'chord'"),
    ("c2_cumulative", {"times": [0, 1]}, "times must have one number for each of the 3 keyframes"),
    ("c2_cumulative", {"times": [0, 1, np.nan]}, "times must be finite"),
    ("c2_cumulative", {"times": [0, 2, 2]}, r"times must increase strictly, got times\[2\] = 2.0"),
    (
        "c2_cumulative",
        {"keys": [[1, 0, 0, 0]]},
        "keys must be a list of at least 2 unit quaternions",
    ),
    (
        "c2_cumulative",
        {"keys": [[1, 0, 0, 0], [1, 1, 0, 0]]},
        r"keys\[1\] must have norm 1 within 1e-06",
    ),
    (
        "c2_cumulative",
        {**same(1, 2, KEYS), "times": "chord"},
        r"keys\[1\] and keys\[2\] the same",
    ),
    *(
        ("c2_cumulative", {"turns": turns}, "turns must be a list of 2 whole numbers")
        for turns in ([1], [0.5, 0], "ab", [[1, 2]], [np.nan, 0])
    ),
    (
        "c2_cumulative",
        {**same(1, 2, KEYS, 1.0), "turns": [0, 1]},
        r"turns must be 0 .* got turns\[1\] = 1",
    ),
    (
        "rotation_vector_spline",
        {"keys": [exp([0.1, 0.2, 0.3]), -exp([0.1, 0.2, 0.3])], "align": False},
        "less than a whole turn",
    ),
    *(
        ("circular_blending", same(*two), r"keys\[{}\] and keys\[{}\] the same".format(*two))
        for two in ((1, 2), (1, 3), (2, 3))
    ),
    ("nielson_shieh", same(1, 2, sign=1.0), r"keys\[1\] and keys\[2\] the same"),
    # A family's own
    *(("kks_interpolating", {"order": order}, "^order must be") for order in (2, 7, 4.5, "6")),
    (
        "kks_interpolating",
        {"order": 4, "start": "clamped", "omega_start": END, "alpha_start": END},
        "alpha_start must be None for order 4",
    ),
    *(
        ("minimum_effort", given, problem)
        for given, problem in (
            ({"order": 3}, "order must be 4 to 6, got 3"),
            ({"order": "4"}, "order must be a whole number"),
            ({"smoothness": 3}, "smoothness must be 2, got 3"),
            ({"order": 6, "smoothness": 1}, "smoothness must be 2 to 4, got 1"),
            ({"spans": 1}, "spans must be 2 to 8, got 1"),
            ({"inertia": [1.0, 2.0]}, "inertia must be three moments or"),
            ({"inertia": [1.0, 2.0, -3.0]}, "inertia must be"),
            ({"inertia": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}, "inertia must be"),
            ({"inertia": "heavy"}, "inertia must be"),
            ({"inertia": [1.0, np.nan, 1.0]}, "inertia must be"),
            ({"start": "clamped"}, "omega_start must be given"),
            ({"end": "state", "omega_end": END}, "alpha_end must be given"),
            ({"omega_start": END}, "omega_start must be None"),
        )
    ),
    *(
        ("nu_spline", {"nu": nu}, "^nu must be")
        for nu in (-1.0, [1, 2], "tight", [1, 2, -3], np.nan)
    ),
    *(("nielson_shieh", {"a1": a1}, "^a1 must be") for a1 in (0.0, -1.0, "even", np.inf)),
    *(("nielson_shieh", {"criterion": c}, "^criterion must be 13 or 14") for c in (12, "13", True)),
    *(("shoemake_bezier", {"s": s}, "^s must be") for s in (0, -0.1, 1.5, "1/0", "third", np.nan)),
]


@pytest.mark.parametrize(("name", "given", "problem"), REFUSED)
def test_a_wrong_parameter_is_refused_by_its_name(name, given, problem):
    with pytest.raises(ValueError, match=problem):
        METHODS[name](**{"keys": KEYS, "times": "uniform", **given})
