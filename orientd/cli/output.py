"""Output of commands: plain lines or one JSON object.

Results go to standard output, errors to standard error.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import time
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TextIO

from orientd.one_line import one_line, shown

_QUATERNIONS = {"q", "feedback_q"}


@dataclass(frozen=True)
class Output:
    """The standard output of a command: lines for people, or one JSON object.

    Attributes:
        as_json: whether to print JSON.
    """

    as_json: bool = False

    def say(self, *lines: str) -> None:
        """Print lines for people, at once: a pipe shows them as they come, like a terminal."""
        if lines and not self.as_json:
            print("\n".join(map(shown, lines)), flush=True)  # noqa: T201

    def answer(self, content: object, *lines: str) -> None:
        """Print the result of a command: *content* as JSON, or *lines* for people."""
        if self.as_json:
            print(json.dumps(plain(content)), flush=True)  # noqa: T201
        self.say(*lines)


def complain(error: Mapping[str, Any], *, as_json: bool, more: str = "") -> None:
    """Print an error: its JSON object, or its message on one line, followed by *more*."""
    said = f"orientd: {one_line(error['message'])}{more}"
    print(json.dumps({"error": error}) if as_json else said, file=sys.stderr)  # noqa: T201


def plain(content: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Return *content* as JSON values; quaternions with named components."""
    if is_dataclass(content) and not isinstance(content, type):
        return {
            field.name: _named(field.name, getattr(content, field.name))
            for field in fields(content)
        }
    if hasattr(content, "DESCRIPTOR"):  # a message, of a library that many commands do without
        from orientd.protocol.reports import plain as plain_message

        return plain(plain_message(content))
    if isinstance(content, Enum):
        return content.name.lower()
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {str(key): _named(str(key), inner) for key, inner in content.items()}
    if isinstance(content, tuple) and hasattr(content, "_asdict"):
        return plain(content._asdict())
    if isinstance(content, list | tuple):
        return [plain(inner) for inner in content]
    if hasattr(content, "tolist"):
        return plain(content.tolist())
    if isinstance(content, Path):
        return str(content)
    return content


def _named(name: str, content: object) -> Any:  # noqa: ANN401 - whatever JSON can hold
    listed = plain(content)
    if name in _QUATERNIONS and isinstance(listed, list) and len(listed) == 4:
        return dict(zip("wxyz", listed, strict=True))
    return listed


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with columns side by side, never cut off.

    >>> table(["name", "rate"], [["arm", "500 Hz"]])
    ['name  rate', 'arm   500 Hz']
    """
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (header, *rows)
    ]


def is_terminal() -> bool:
    """Return whether standard output is a terminal."""
    return sys.stdout.isatty()


class LiveLine:
    """A line on a terminal that each text replaces, and that is never wider than the terminal."""

    def __init__(self, stream: TextIO) -> None:
        """Write to the terminal *stream*."""
        self._stream, self._columns = stream, 0

    def show(self, text: str) -> None:
        """Replace the line by *text*, without the end that the terminal has no room for."""
        # After a character in the last column some terminals have begun a new line.
        most = _width(self._stream) - 1
        text, columns = fitted(shown(text).replace("\n", " ").replace("\t", " "), most)
        # Spaces, since not every terminal knows a code that erases.
        erased = " " * (min(self._columns, most) - columns)
        self._columns = columns
        self._stream.write(f"\r{text}{erased}\r{text}" if erased else f"\r{text}")
        self._stream.flush()

    def end(self) -> None:
        """Leave the line as it is, and go to the next one."""
        self._stream.write("\n")
        self._stream.flush()


@contextlib.contextmanager
def updated(out: Output, *, interval: float) -> Iterator[Callable[[str], None]]:
    """Yield a function that shows the newest text while the context lasts.

    A terminal has one line for it.  Elsewhere each text is a line, but those that come less than
    *interval* (s) after the last one are left out.
    """
    if is_terminal() and not out.as_json:
        line = LiveLine(sys.stdout)
        try:
            yield line.show
        finally:
            line.end()
        return
    due = -math.inf

    def show(text: str) -> None:
        nonlocal due
        if (now := time.monotonic()) >= due:
            due = now + interval
            out.say(text)

    yield show


def fitted(text: str, most: int) -> tuple[str, int]:
    """Return the part of *text* that fits into *most* columns, and how many columns it takes.

    >>> fitted("orientd", 4), fitted("動く", 3)
    (('orie', 4), ('動', 2))
    """
    columns = 0
    for place, character in enumerate(text):
        is_wide = unicodedata.east_asian_width(character) in ("W", "F")
        taken = 0 if unicodedata.combining(character) else 2 if is_wide else 1
        if columns + taken > most:
            return text[:place], columns
        columns += taken
    return text, columns


def _width(stream: TextIO) -> int:
    """Return the width of a terminal, from ``$COLUMNS`` or the terminal itself, else 80."""
    asked = os.environ.get("COLUMNS", "")
    if asked.isdecimal() and int(asked):
        return int(asked)
    try:
        return os.get_terminal_size(stream.fileno()).columns or 80
    except (OSError, ValueError):
        return 80


def close_output() -> None:
    """Discard buffered output: the reader has closed the pipe."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def working(title: str) -> Iterator[None]:
    """Show the present activity while the context lasts, on standard error of a terminal only."""
    if not sys.stderr.isatty():
        yield
        return
    line = LiveLine(sys.stderr)
    line.show(f"{title} ...")
    try:
        yield
    finally:
        line.show("")
