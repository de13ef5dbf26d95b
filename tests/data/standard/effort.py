"""The effort of every family on random keyframes, relative to the least there is.

`python tests/data/standard/effort.py [SEEDS]` (or `make standard`) writes `EFFORT.md`: ten random
keyframes a second apart, neighbours a given angle apart (give or take 30 %, below 178 degrees)
about random axes, natural ends.  Medians over the seeds of the integral of the squared acceleration
and of its peak, each relative to the curve of least effort (`min_acceleration`).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orientd.curves import METHODS, CurveTask, make_curve
from orientd.curves.comparison import Figures, measure
from orientd.errors import PlanError
from orientd.rotation import exp, multiply

KEYFRAMES = 10
STEPS_DEG = (10, 45, 90, 135, 170)
VARIATION = 0.3
LARGEST_DEG = 178.0
"""Steps vary by this share of their size, or by less so that all stay below half a turn."""

SEEDS = 50
OPTIMUM = "min_acceleration"


@dataclass(frozen=True)
class Variant:
    """A family with its options.

    Attributes:
        title: in the table.
        family: its name in METHODS.
        options: what differs from its defaults.
    """

    title: str
    family: str
    options: Mapping[str, Any]


VARIANTS = (
    Variant("C2 cumulative", "c2_cumulative", {}),
    Variant("Nielson-Heiland", "nielson_heiland", {}),
    Variant("cubic rotation vector", "rotation_vector_spline", {}),
    Variant("normalised cubic", "normalized_cubic", {}),
    Variant("nu-spline, nu = 2", "nu_spline", {"nu": 2.0}),
    Variant("Shoemake, s = 1/3", "shoemake_bezier", {"s": "1/3"}),
    Variant("KKS Hermite spline", "kks_hermite_spline", {}),
    Variant("Schlag Catmull-Rom", "schlag_catmull_rom", {}),
    Variant("squad", "squad", {}),
    Variant("1/6 Catmull-Rom Bezier", "bezier_catmull_rom", {}),
    Variant("circular blending (notes)", "circular_blending", {}),
    Variant("spherical quadratic (21)", "spherical_quadratic", {}),
    Variant("Shoemake, s = 1 (as printed)", "shoemake_bezier", {"s": 1.0}),
    Variant("Nielson-Shieh", "nielson_shieh", {"require_positive": False}),
)


def random_task(step_deg: float, seed: int) -> CurveTask:
    """Return keyframes a second apart, each about *step_deg* from the last, about a random axis."""
    rng = np.random.default_rng([seed, round(step_deg)])
    variation = min(VARIATION * step_deg, LARGEST_DEG - step_deg)
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for axis in rng.normal(size=(KEYFRAMES - 1, 3)):
        turn = np.radians(step_deg + variation * rng.uniform(-1.0, 1.0))
        keys.append(multiply(keys[-1], exp(turn * axis / np.linalg.norm(axis))))
    return CurveTask(np.array(keys), np.arange(float(KEYFRAMES)))


def figures_of(variant: Variant, task: CurveTask) -> Figures | None:
    """Return the figures of a variant; ``None`` where it has no curve."""
    try:
        return measure(make_curve(METHODS[variant.family], task, variant.options), task)
    except (ValueError, PlanError):
        return None


@dataclass(frozen=True)
class Column:
    """The efforts at one step.

    Attributes:
        optima: effort and peak acceleration of the optimum, shape ``(seeds, 2)``.
        ratios: by title, effort and peak relative to the optimum's, shape ``(seeds, 2)``, not a
            number where the family has no curve.
    """

    optima: np.ndarray
    ratios: Mapping[str, np.ndarray]


def column(step_deg: float, seeds: Iterable[int], variants: Iterable[Variant] = VARIANTS) -> Column:
    """Return the efforts of *variants* at one step."""
    optimum, chosen = Variant("optimum", OPTIMUM, {}), tuple(variants)
    optima, ratios = [], {variant.title: [] for variant in chosen}
    for seed in seeds:
        task = random_task(step_deg, seed)
        least = figures_of(optimum, task)
        if least is None:
            continue
        optima.append((least.effort, least.peak_acceleration))
        for variant in chosen:
            found = figures_of(variant, task)
            ratios[variant.title].append(
                (np.nan, np.nan)
                if found is None
                else (
                    found.effort / least.effort,
                    found.peak_acceleration / least.peak_acceleration,
                )
            )
    return Column(np.array(optima), {title: np.array(row) for title, row in ratios.items()})


def table(columns: Mapping[float, Column], seeds: int) -> str:
    """Return the table as Markdown."""
    lines = [
        "# Effort on random keyframes",
        "",
        f"Medians over {seeds} seeds of the integral of the squared acceleration and of its peak,",
        "each relative to the curve of least effort, through ten random keyframes a second apart",
        "with natural ends; steps vary by 30 % about the angle named, below 178 degrees.  Where a",
        "family had no curve for some seeds, their number stands behind.  Made by `effort.py`.",
        "",
        "| family | " + " | ".join(f"{step:g} deg" for step in columns) + " |",
        "|---" * (len(columns) + 1) + "|",
        "| least effort (rad^2/s^3; rad/s^2) | "
        + " | ".join(_pair(np.median(c.optima, axis=0), "{:.3g}") for c in columns.values())
        + " |",
    ]
    for variant in VARIANTS:
        cells = []
        for found in columns.values():
            ratios = found.ratios[variant.title]
            missing = int(np.isnan(ratios[:, 0]).sum())
            cell = _pair(np.nanmedian(ratios, axis=0), "{:.4g}")
            cells.append(f"{cell} ({missing} have none)" if missing else cell)
        lines.append(f"| {variant.title} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _pair(values, form: str) -> str:
    return "; ".join(form.format(value) for value in values)


def main(seeds: int) -> None:
    """Write the table."""
    columns = {}
    for step in STEPS_DEG:
        columns[step] = column(step, range(seeds))
        print(f"{step} deg done", flush=True)
    path = Path(__file__).parent / "EFFORT.md"
    path.write_text(table(columns, seeds), encoding="utf-8")
    print(f"wrote {path}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS)
