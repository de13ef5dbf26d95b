"""A page of interpolation cases, wrong input included: each is planned and drawn by the build."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from orientd import motion_file
from orientd.errors import OrientdError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.plots import draw

FOLDER = "explanation/curves"
START = State.at_rest((1.0, 0.0, 0.0, 0.0))
PERIOD = 0.002

_HEAD = """\
# Interpolation cases

Each case is a motion file with its picture, or with the line that refuses it. All of
them start from a device at rest in the identity, with the default limits. The build of these pages
plans and draws them.
"""


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the page.

    Raises:
        ValueError: a case is refused that should not be, or the other way round.
    """
    file = source / FOLDER / "cases.toml"
    cases = tomllib.loads(file.read_text(encoding="utf-8"))["cases"]
    drawn = "".join(_case(number, case, file) for number, case in enumerate(cases, 1))
    yield f"{FOLDER}/cases.md", _HEAD + drawn


def _case(number: int, case: Mapping[str, Any], file: Path) -> str:
    title, is_refused = case["title"], case.get("is_refused", False)
    text = f"\n## {title}\n\n{case['text']}\n\n```yaml\n{case['motion']}```\n\n"
    try:
        request = motion_file.loads(case["motion"].encode(), title)
        motion = plan(request, start=START, limits=DEFAULT_LIMITS, period=PERIOD)
    except OrientdError as error:
        if not is_refused:
            raise ValueError(f"{file.name}: {title!r} is refused: {error}") from error
        return f"{text}```text\n{error}\n```\n"
    if is_refused:
        raise ValueError(f"{file.name}: {title!r} is not refused")
    picture = file.parent / "pictures" / f"case-{number}.png"
    picture.parent.mkdir(exist_ok=True)
    if not picture.exists() or picture.stat().st_mtime < file.stat().st_mtime:
        draw(motion, picture, title=title)
    notes = "".join(f"The certificate notes: {note}.\n\n" for note in motion.certificate.notes)
    shown = f"{title}: paths of the axes, velocity, acceleration"
    return f"{text}{notes}![{shown}](pictures/{picture.name})\n"
