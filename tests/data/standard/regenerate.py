"""The published results of the standard test set: what every family makes of every sequence.

`python tests/data/standard/regenerate.py [NAME ...]` (or `make standard`) writes `NAME.csv` beside
`NAME.yaml`, and `README.md`.  Figures have six digits; times of building and sampling, which differ
from machine to machine, are left out.
"""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path

import numpy as np

from orientd import motion_file
from orientd.curves import METHODS, make_curve
from orientd.curves.comparison import measure
from orientd.errors import PlanError
from orientd.planner.task import task_of

HERE = Path(__file__).parent
INERTIA = np.array([1.0, 2.0, 3.0])
COLUMNS = (
    "family",
    "interpolates",
    "keyframe_error",
    "continuity",
    "velocity_jump",
    "end_velocity_error",
    "peak_velocity",
    "peak_acceleration",
    "effort",
    "torque_effort",
    "path_length",
    "why_not",
)
ROUNDING = 1e-9
"""An error or a jump of no more than this is rounding, and published as 0."""

UNITS = """\
`keyframe_error` is in rad, velocities in rad/s, `peak_acceleration` in rad/s^2; `effort` is the
integral of the squared angular acceleration between the keyframes in rad^2/s^3, `torque_effort`
that of the squared torque for principal moments of 1, 2 and 3 kg m^2 in N^2 m^2 s, `path_length`
the integral of the angular velocity in rad.  Where `velocity_jump` is not 0, the acceleration is
infinite at a keyframe, and peak and integrals leave that out.  A family that does not apply says
why.  Ends are natural (without acceleration) unless the file gives velocities there.
"""


def names() -> list[str]:
    """Return the names of the sequences."""
    return sorted(path.stem for path in HERE.glob("*.yaml"))


def row(name: str, task) -> dict[str, str]:
    """Return the published figures of one family."""
    try:
        curve = make_curve(METHODS[name], task)
    except (ValueError, PlanError) as error:
        return {"family": name, "why_not": str(error)}
    figures = measure(curve, task, inertia=INERTIA)
    error = figures.end_velocity_error
    return {
        "family": name,
        "interpolates": "yes" if figures.interpolates else "no",
        "keyframe_error": _digits(figures.keyframe_error),
        "continuity": str(figures.continuity),
        "velocity_jump": _digits(figures.velocity_jump if figures.has_velocity_jumps else 0.0),
        "end_velocity_error": "" if error is None else _digits(error),
        "peak_velocity": f"{figures.peak_velocity:.6g}",
        "peak_acceleration": _digits(figures.peak_acceleration),
        "effort": _digits(figures.effort, 1e-18 * figures.path_length**2),
        "torque_effort": f"{figures.torque_effort:.6g}",
        "path_length": f"{figures.path_length:.6g}",
    }


def _digits(value: float, rounding: float = ROUNDING) -> str:
    return "0" if value <= rounding else f"{value:.6g}"


def rows(sequence: str, families=tuple(METHODS)) -> list[dict[str, str]]:
    """Return the results of a sequence, least effort first as `orientd compare --ends natural`."""
    request = motion_file.load(HERE / f"{sequence}.yaml")
    task = task_of(request, "chord" if request.times is None else "file", "natural")
    return sorted((row(name, task) for name in families), key=_rank)


def _rank(result: dict[str, str]) -> tuple[int, bool, float, str]:
    if "why_not" in result:
        return 3, False, 0.0, result["family"]
    return (
        2 if result["interpolates"] == "no" else int(not is_met(result)),
        result["velocity_jump"] != "0",
        float(result["effort"]),
        result["family"],
    )


def is_met(result: dict[str, str]) -> bool:
    """Return whether a curve has the velocities that are wanted at its ends."""
    return result.get("end_velocity_error", "0") in ("", "0")


def table(results: list[dict[str, str]]) -> str:
    """Return results as a file of comma-separated values."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(results)
    return text.getvalue()


def published(sequence: str) -> list[dict[str, str]]:
    """Return the results of a sequence as they are published."""
    with (HERE / f"{sequence}.csv").open(encoding="utf-8", newline="") as file:
        return [{key: value for key, value in one.items() if value} for one in csv.DictReader(file)]


def readme() -> str:
    """Return the overview of all published results."""
    lines = [
        "# Standard test set",
        "",
        "Nielson (1993) closes by asking for standard test cases and standard methods of comparing",
        "techniques of orientation.  These are ours: motion files (`orientd compare NAME.yaml",
        "--ends natural` measures them, `orientd plot NAME.yaml` draws them), each with what every",
        "family makes of it in `NAME.csv`.  `sequences.py` says how the files came about;",
        "`regenerate.py` makes the tables, and this overview, anew.  `EFFORT.md` is of random",
        "keyframes, by `effort.py`.",
        "",
        UNITS,
        "| sequence | what it is | least effort | c2_cumulative | meet keyframes | do not apply |",
        "|---|---|---|---|---|---|",
    ]
    for sequence in names():
        title = (HERE / f"{sequence}.yaml").read_text(encoding="utf-8").splitlines()[0][2:]
        results = published(sequence)
        best = results[0]
        own = next(one for one in results if one["family"] == "c2_cumulative")
        met = sum(one.get("interpolates") == "yes" for one in results)
        absent = sum("why_not" in one for one in results)
        lines.append(
            f"| [{sequence}]({sequence}.csv) | {title} | {best['effort']} ({best['family']}) | "
            f"{own.get('effort', 'none')} | {met} | {absent} |"
        )
    return "\n".join(lines) + "\n"


def main(chosen: list[str]) -> None:
    """Write the tables of the sequences *chosen*, of all if none is, and the overview."""
    for sequence in chosen or names():
        (HERE / f"{sequence}.csv").write_text(table(rows(sequence)), encoding="utf-8")
        print(f"wrote {sequence}.csv", flush=True)
    (HERE / "README.md").write_text(readme(), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
