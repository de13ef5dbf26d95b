"""The motion file: from YAML, JSON or a mapping to a motion request, and back.

Any problem is one :class:`~orientd.errors.RequestError` with the path of the field, the expected
value and the given one:

>>> parse({"keyframes": []})
Traceback (most recent call last):
    ...
orientd.errors.RequestError: keyframes: expected at least 1, got 0; add one
"""

from __future__ import annotations

from pathlib import Path

from orientd.errors import RequestError, naming
from orientd.model.orientation import FORMS
from orientd.model.reading import read_request as parse
from orientd.model.reading import written
from orientd.model.request import MotionRequest
from orientd.model.schema import motion_schema
from orientd.structured_text import parse_structured, read_structured

_RECORDINGS = (".bag", ".csv", ".db3", ".mcap", ".tum")

__all__ = ["FORMS", "load", "loads", "motion_schema", "parse", "written"]


def load(path: str | Path) -> MotionRequest:
    """Return the request in a YAML or JSON file.

    Raises:
        RequestError: the file cannot be read, is neither YAML nor JSON, or has no well-formed
            motion.
    """
    try:
        content = read_structured(Path(path))
        with naming(str(path)):
            return parse(content)
    except RequestError as error:
        if Path(path).suffix not in _RECORDINGS or not Path(path).is_file():
            raise
        problem = f"{path}: a recording by its name, expected a motion file in YAML or JSON"
        raise RequestError("", f"{problem}; plan it with `orientd replay --dry-run`") from error


def loads(content: bytes, name: str) -> MotionRequest:
    """Return the request in the *content* of a file called *name*; see :func:`load`."""
    read = parse_structured(content, name)
    with naming(name):
        return parse(read)
