"""The effort of the families on random keyframes, against medians that other code has measured.

That code had other random keyframes, so the values agree within the scatter of medians.
"""

import effort
import numpy as np
import pytest

MEASURED_ELSEWHERE = """
C2 cumulative               | 1.000; 1.00 | 1.003; 1.00 | 1.016; 0.99 | 1.046; 1.00 | 1.078; 1.01
Nielson-Heiland             | 1.000; 1.00 | 1.000; 1.00 | 1.001; 1.00 | 1.005; 1.00 | 1.011; 1.04
cubic rotation vector       | 1.000; 1.00 | 1.000; 1.00 | 1.006; 1.01 | 1.040; 1.04 | 1.151; 1.12
normalised cubic            | 1.000; 1.00 | 1.003; 0.99 | 1.040; 0.97 | 1.212; 0.97 | 1.432; 1.06
nu-spline, nu = 2           | 1.11; 1.12  | 1.13; 1.11  | 1.20; 1.07  | 1.46; 1.04  | 1.86; 1.09
Shoemake, s = 1/3           | 1.17; 1.22  | 1.17; 1.22  | 1.17; 1.24  | 1.20; 1.30  | 1.36; 1.45
KKS Hermite spline          | 1.17; 1.22  | 1.18; 1.23  | 1.19; 1.25  | 1.27; 1.30  | 1.41; 1.40
Schlag Catmull-Rom          | 1.17; 1.22  | 1.17; 1.23  | 1.19; 1.24  | 1.26; 1.24  | 1.41; 1.22
squad                       | 1.17; 1.22  | 1.17; 1.22  | 1.19; 1.24  | 1.30; 1.32  | 1.61; 1.50
1/6 Catmull-Rom Bezier      | 1.18; 1.22  | 1.24; 1.27  | 1.50; 1.34  | 2.14; 1.55  | 3.75; 1.93
circular blending (notes)   | 2.2; 1.9    | 2.3; 1.9    | 2.1; 1.8    | 2.2; 2.0    | 1.6; 1.5
spherical quadratic (21)    | 4.7; 1.5    | 4.7; 1.6    | 4.4; 1.5    | 3.3; 1.3    | 2.5; 1.4
Shoemake, s = 1 (as printed)| 6.2; 2.7    | 6.5; 2.7    | 6.7; 2.9    | 10.5; 3.3   | 16.4; 4.1
Nielson-Shieh               | 356; 50     | 387; 67     | 62; 18      | 28; 9       | 12; 5
"""
"""Integral of squared acceleration and its peak relative to the optimum, 50 seeds a column."""

OPTIMA_ELSEWHERE = {
    10: (0.980, 0.74),
    45: (20.6, 3.4),
    90: (82.2, 6.5),
    135: (169.6, 9.2),
    170: (222.0, 10.1),
}
THEIR_SEEDS = 50
SIGMAS = 4.0
QUICK = ("C2 cumulative", "normalised cubic", "Shoemake, s = 1/3", "KKS Hermite spline", "squad")


def measured_elsewhere():
    """By title and step: each value with half a unit of its last digit."""
    table = {}
    for line in MEASURED_ELSEWHERE.strip().splitlines():
        title, *cells = (part.strip() for part in line.split("|"))
        for step, cell in zip(effort.STEPS_DEG, cells, strict=True):
            numbers = [number.strip() for number in cell.split(";")]
            decimals = [len(number.partition(".")[2]) for number in numbers]
            table[title, step] = [
                (float(number), 0.5 * 10.0**-places)
                for number, places in zip(numbers, decimals, strict=True)
            ]
    return table


def scatter(sample):
    """The standard error of the difference of our median and theirs, by the spread of ours."""
    deviation = 1.4826 * np.median(np.abs(sample - np.median(sample)))
    return 1.2533 * deviation * np.sqrt(1.0 / len(sample) + 1.0 / THEIR_SEEDS)


def is_agreed(ours, theirs, rounding):
    known = ours[np.isfinite(ours)]
    return abs(np.median(known) - theirs) <= SIGMAS * scatter(known) + rounding


def disagreements(step, seeds, titles):
    """Return what differs from the other measurements: who, which quantity, ours and theirs."""
    variants = [variant for variant in effort.VARIANTS if variant.title in titles]
    found = effort.column(step, seeds, variants)
    assert len(found.optima) >= 0.9 * len(seeds)
    differing = []
    for kind in (0, 1):
        theirs = OPTIMA_ELSEWHERE[step][kind]
        compared = [("optimum", found.optima[:, kind], theirs, 0.005 * theirs)]
        for variant in variants:
            value = measured_elsewhere()[variant.title, step][kind]
            compared.append((variant.title, found.ratios[variant.title][:, kind], *value))
        differing += [
            (title, kind, np.median(ours[np.isfinite(ours)]), value)
            for title, ours, value, rounding in compared
            if not is_agreed(ours, value, rounding)
        ]
    return differing


@pytest.mark.parametrize(
    "step", [*(pytest.param(step, marks=pytest.mark.slow) for step in (10, 90)), 170]
)
def test_effort_agrees_with_other_measurements_on_a_few_keyframes(step):
    assert disagreements(step, range(300, 312), QUICK) == []


@pytest.mark.slow
@pytest.mark.parametrize("step", effort.STEPS_DEG)
def test_effort_agrees_with_other_measurements(step):
    titles = [variant.title for variant in effort.VARIANTS]
    assert disagreements(step, range(100, 150), titles) == []


@pytest.mark.slow
def test_the_published_efforts_are_what_the_families_take():
    path = effort.Path(effort.__file__).parent / "EFFORT.md"
    columns = {step: effort.column(step, range(effort.SEEDS)) for step in effort.STEPS_DEG}
    assert path.read_text(encoding="utf-8") == effort.table(columns, effort.SEEDS)
