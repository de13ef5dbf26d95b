"""The motion file: from YAML, JSON or a mapping to a motion request, and back.

Any problem is one :class:`~orientd.errors.RequestError` with the path of the field, the expected
value and the given one:

>>> parse({"keyframes": []})
Traceback (most recent call last):
    ...
orientd.errors.RequestError: keyframes: expected at least 1, got 0; add one
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from orientd.errors import RequestError, naming
from orientd.files import file_content
from orientd.model.orientation import FORMS
from orientd.model.reading import read_request as parse
from orientd.model.reading import written
from orientd.model.request import MotionRequest
from orientd.model.schema import motion_schema
from orientd.one_line import one_line
from orientd.structured_text import parse_structured

_RECORDINGS = (".bag", ".csv", ".db3", ".mcap", ".tum")

__all__ = ["FORMS", "content", "load", "loads", "motion_schema", "parse", "written"]


def load(path: str | Path) -> MotionRequest:
    """Return the request in a YAML or JSON file.

    Raises:
        RequestError: the file cannot be read, is neither YAML nor JSON, or has no well-formed
            motion.
    """
    return loads(content(Path(path)), str(path))


def content(path: Path) -> bytes:
    """Return the bytes of a motion file.

    Raises:
        RequestError: it cannot be read, or is too large.
    """
    try:
        return file_content(path)
    except RequestError as error:
        if path.suffix not in _RECORDINGS or not path.is_file():
            raise
        raise _of_recording(str(path)) from error


def loads(
    text: bytes,
    name: str = "",
    *,
    rows: Sequence[Mapping[str, Any]] = (),
    most: int | None = None,
) -> MotionRequest:
    """Return the request in the *text* of a motion file.

    Args:
        text: in YAML or JSON.
        name: of the file, for errors; empty if the text is from no file.
        rows: the keyframes, in place of those in the text, which then has none.
        most: keyframes that it may have.

    Raises:
        RequestError: it is neither YAML nor JSON, or has no well-formed motion.
    """
    name = one_line(name)
    try:
        mapping = parse_structured(text, name or "the motion")
        with naming(name) if name else nullcontext():
            return parse(_with_keyframes(mapping, rows, most))
    except RequestError as error:
        if Path(name).suffix not in _RECORDINGS:
            raise
        raise _of_recording(name) from error


def _with_keyframes(mapping: object, rows: Sequence[object], most: int | None) -> object:
    """Return what a text says, with *rows* as its keyframes if there are any.

    Raises:
        RequestError: it has keyframes as well, or there are too many.
    """
    if not isinstance(mapping, dict):
        return mapping
    if rows:
        if mapping.get("keyframes") not in (None, []):
            raise RequestError("columns", "expected without keyframes only")
        mapping["keyframes"] = rows
    keyframes = mapping.get("keyframes")
    if most is not None and isinstance(keyframes, list) and len(keyframes) > most:
        raise RequestError("keyframes", f"expected at most {most}, got {len(keyframes)}")
    return mapping


def _of_recording(name: str) -> RequestError:
    problem = f"{name}: a recording by its name, expected a motion file in YAML or JSON"
    return RequestError("", f"{problem}; plan it with `orientd replay --dry-run`")
