"""A page for each family of curves: picture, formula, source, figures, when to choose it."""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Iterator
from pathlib import Path

from generators.gallery import draw_gallery
from generators.gallery import task_for as family_task
from orientd.curves import METHODS, CurveTask, make_curve
from orientd.curves.comparison import Figures, measure

FOLDER = "explanation/curves"


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the pages; the pictures are drawn where the code is newer than they are."""
    chosen = tomllib.loads((source / FOLDER / "when.toml").read_text(encoding="utf-8"))
    if missing := set(METHODS) ^ set(chosen):
        raise ValueError(
            f"{FOLDER}/when.toml: differs from METHODS in {', '.join(sorted(missing))}"
        )
    _draw(source / FOLDER / "pictures")
    rows = []
    for name, family in METHODS.items():
        task = family_task(name)
        figures = measure(make_curve(family, task), task)
        yield f"{FOLDER}/{name}.rst", "\n".join(_page(name, chosen[name], task, figures))
        met = "yes" if family.interpolates else "no"
        ends = "yes" if family.meets_end_velocities else "no"
        rows.append(
            f"| [`{name}`]({name}.rst) | {family.summary} | C{figures.continuity} | {met} | {ends} "
            f"| {figures.effort:.3g} |"
        )
    table = "\n".join(
        ["| method | description | smooth | meets keyframes | meets end velocities | effort |",
         "|---|---|---|---|---|---|", *rows]
    )  # fmt: skip
    contents = "\n".join(["```{toctree}", ":hidden:", "", "cases", *METHODS, "```"])
    text = (source / FOLDER / "overview.txt").read_text(encoding="utf-8")
    yield f"{FOLDER}/index.md", text.replace("@made@", table) + "\n" + contents + "\n"


def _draw(folder: Path) -> None:
    """Draw all families, where the code of one is newer than the sheet of them."""
    sheet = folder / "all.svg"
    codes = [Path(inspect.getfile(family)) for family in METHODS.values()]
    if not sheet.exists() or sheet.stat().st_mtime < max(one.stat().st_mtime for one in codes):
        list(draw_gallery(folder))


def _page(name: str, when: str, task: CurveTask, figures: Figures) -> Iterator[str]:
    family = METHODS[name]
    met, ends = family.interpolates, family.meets_end_velocities
    moved = "changes the curve nearby" if family.local else "changes the whole curve"
    yield f"""\
{name}
{"=" * len(name)}

{family.summary[0].upper()}{family.summary[1:]}.

When to choose it
-----------------

{when.strip()}

.. image:: pictures/{name}.svg
   :alt: {name} on {len(task.keys)} keyframes: paths of the axes, velocity, acceleration

What it is
----------

:Source: {family.source}
:Continuity: C{figures.continuity}, measured on the example above
:Keyframes: {"met" if met else f"approached, here to {figures.keyframe_error:.2g} rad"}
:End velocities: {"met exactly" if ends else "cannot be prescribed"}
:Moving one keyframe: {moved}
:Effort: {figures.effort:.4g} rad²/s³
:Peaks: {figures.peak_velocity:.3g} rad/s, {figures.peak_acceleration:.3g} rad/s²

.. autoclass:: {family.__module__}.{family.__name__}
   :no-members:
   :no-index:
"""
