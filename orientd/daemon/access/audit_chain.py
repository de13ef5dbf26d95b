"""The lines of the audit log as a chain: each has its number and the digest of the one before it.

A line that was changed, taken out or put in breaks the chain at that place.  What it cannot show by
itself is that its end was cut off: whoever keeps the digest of the last line, which the daemon logs
when it begins and ends, can.
"""

from __future__ import annotations

import glob
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from orientd.errors import OrientdError

LONGEST_LINE = 256 * 1024
MOST_PROBLEMS = 100
"""That are told of one log."""


def digest(line: bytes) -> str:
    """Return the digest of a line, which is without its end."""
    return hashlib.sha256(line).hexdigest()


def chained(record: Mapping[str, Any], number: int, previous: str) -> bytes:
    """Return *record* as line *number*, after one with the digest *previous*."""
    content = {"line": number, "previous": previous, **record}
    line = json.dumps(content, ensure_ascii=False, default=str)
    if not line.isprintable():
        # Nothing that a terminal would do something about.
        line = json.dumps(content, default=str)
    return line.encode() + b"\n"


def end_of(descriptor: int) -> tuple[int, str, bool]:
    """Return number and digest of the last line of a file, and whether that line is whole.

    The number is 0 where there is no line.
    """
    size = os.fstat(descriptor).st_size
    content = os.pread(descriptor, LONGEST_LINE, max(0, size - LONGEST_LINE))
    lines = content.splitlines()
    if not lines:
        return 0, "", True
    number = 0
    for line in lines:
        number = _place(line)[0] or number + 1
    return number, digest(lines[-1]), content.endswith(b"\n")


@dataclass
class Verified:
    """What a log was found to be.

    Attributes:
        files: oldest first.
        lines: how many there are.
        first: number of the first one; those before it were forgotten, as the log had grown large.
        last: number of the last one.
        digest: of the last one.
        problems: what is wrong, place by place; none where the chain is whole.
    """

    files: list[Path] = field(default_factory=list)
    lines: int = 0
    first: int = 0
    last: int = 0
    digest: str = ""
    problems: list[str] = field(default_factory=list)


def verify_audit(path: Path) -> Verified:
    """Follow the chain through the log at *path* and what was put aside of it.

    Raises:
        OrientdError: there is no log, or it cannot be read.
    """
    found = Verified(files=_files(path))
    has_chain = False
    for place, line in _lines(found.files):
        number, previous = _place(line)
        found.lines += 1
        if number and found.lines == 1:
            found.first = number
        elif number and (has_chain or found.digest) and previous != found.digest:
            missing = number - found.last - 1
            what = f"lines are missing before it: {missing}" if missing > 0 else "does not follow"
            found.problems.append(f"{place}: {what}")
        found.last = number or found.last + 1
        found.digest = digest(line)
        has_chain = has_chain or bool(number)
        if len(found.problems) == MOST_PROBLEMS:
            break
    if found.lines and not number:
        found.problems.append(f"{place}: no line of the log")
    return found


def _files(path: Path) -> list[Path]:
    numbers = [
        int(aside.name.removeprefix(f"{path.name}."))
        for aside in path.parent.glob(f"{glob.escape(path.name)}.*")
        if aside.name.removeprefix(f"{path.name}.").isdecimal()
    ]
    files = [path.with_name(f"{path.name}.{number}") for number in sorted(numbers, reverse=True)]
    return [*files, path] if path.exists() or not files else files


def _lines(files: list[Path]) -> Iterator[tuple[str, bytes]]:
    for path in files:
        try:
            with path.open("rb") as file:
                lines = iter(partial(file.readline, LONGEST_LINE), b"")
                for number, line in enumerate(lines, 1):
                    yield f"{path.name}, line {number}", line.removesuffix(b"\n")
        except OSError as error:
            raise OrientdError(f"cannot read {path}: {error.strerror}") from error


def _place(line: bytes) -> tuple[int, str]:
    """Return its number and the digest of the line before, as *line* says them; or 0."""
    try:
        content = json.loads(line)
        number, previous = content["line"], content["previous"]
    except (ValueError, LookupError, TypeError, RecursionError):
        return 0, ""
    is_place = isinstance(number, int) and isinstance(previous, str) and number > 0
    return (number, previous) if is_place else (0, "")
