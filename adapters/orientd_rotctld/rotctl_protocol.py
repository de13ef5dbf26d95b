r"""The text protocol of Hamlib's rotctld: lines to commands, and answers to text.

Facts from Hamlib's ``tests/rotctl_parse.c`` and from sessions with its rotctld 4.5.4.  A command is
a letter, or a backslash and a name: ``P 120 30``, ``\set_pos 120 30``.  A line may have several.  A
punctuation mark before a command asks for the extended form of the answer.  That has the name, then
each value with its name, separated by that mark, or by ends of line for ``+``.

Unlike rotctld, a command ends with its line at the latest, numbers must be whole words, and a bad
command is answered and ends its line: rotctld waits for more, or answers nothing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

OK, INVALID, TIMEOUT, IO_ERROR, REJECTED, UNAVAILABLE = 0, 1, 5, 6, 9, 11
"""Codes of Hamlib; a negative one answers a command that failed."""

LONGEST = 1024
"""Longest line, bytes."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A command of the protocol.

    Attributes:
        name: the long form.
        arguments: number of words that follow.
    """

    name: str
    arguments: int = 0


KINDS = {
    "P": Kind("set_pos", 2),
    "p": Kind("get_pos"),
    "K": Kind("park"),
    "S": Kind("stop"),
    "R": Kind("reset", 1),
    "M": Kind("move", 2),
    "_": Kind("get_info"),
    "s": Kind("get_status"),
    "1": Kind("dump_caps"),
    "\x8f": Kind("dump_state"),
    "q": Kind("quit"),
}
"""The served commands, by letter."""

_NAMED = {kind.name: kind for kind in KINDS.values()}
_NOT_SERVED = frozenset("VvUuXxCwLlDdEeBAa3")
_NAMES_NOT_SERVED = {
    *("set_level", "get_level", "set_func", "get_func", "set_parm", "get_parm", "set_conf"),
    *("get_conf", "send_cmd", "dump_conf", "lonlat2loc", "loc2lonlat", "dms2dec", "dec2dms"),
    *("dmmm2dec", "dec2dmmm", "qrb", "a_sp2a_lp", "d_sp2d_lp", "pause"),
}
_SHOWN = 40
"""Most characters of a line that a message shows."""
_UNSERVED = "not served: a device has no levels, functions or parameters"
_UNKNOWN = f"unknown command, expected one of {', '.join(KINDS).replace(chr(0x8F), 'dump_state')}"
_WORD = re.compile(r"\\(\w*)|(.)", re.ASCII | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Command:
    """A command of a line, or the error in it.

    Attributes:
        kind: of the command; ``None`` for a bad one.
        arguments: the words that follow.
        separator: between the parts of an extended answer; empty for a plain answer.
        error: code of a bad command.
        problem: what is wrong with a bad command, in one line.
    """

    kind: Kind | None
    arguments: tuple[str, ...] = ()
    separator: str = ""
    error: int = OK
    problem: str = ""


def commands(line: bytes) -> Iterator[Command]:
    r"""Yield the commands of a line; a bad one is the last.

    >>> [one.kind.name for one in commands(b"S;p P 10 20\n")]
    ['stop', 'get_pos', 'set_pos']
    >>> next(commands(b"\\set_pos 10\n")).error
    1
    """
    if len(line) > LONGEST:
        problem = f"a line of more than {LONGEST} bytes; end each command with a line feed"
        yield Command(None, error=INVALID, problem=problem)
        return
    text = line.decode("latin-1").rstrip("\r\n\0 \t")
    place = 0
    while True:
        while place < len(text) and text[place].isspace():
            place += 1
        if place >= len(text) or text[place] == "#":
            return
        separator = ""
        if text[place] == "+":
            separator, place = "\n", place + 1
        if place < len(text) and text[place] in "!\"$%&'()*,-./:;<=>@[]^`{|}~":
            separator, place = text[place], place + 1
        word = _WORD.match(text, place)
        if word is None:
            problem = f"expected a command after {text[:_SHOWN]!r}"
            yield Command(None, separator=separator, error=INVALID, problem=problem)
            return
        name, letter = word.groups()
        kind = _NAMED.get(name) if letter is None else KINDS.get(letter.replace("Q", "q"))
        if kind is None:
            known = name in _NAMES_NOT_SERVED or letter in _NOT_SERVED
            problem = _UNSERVED if known else _UNKNOWN
            yield Command(
                None,
                separator=separator,
                error=UNAVAILABLE if known else INVALID,
                problem=f"{word.group()[:_SHOWN]!r}: {problem}",
            )
            return
        words = text[word.end() :].split(None, kind.arguments)
        given = tuple(words[: kind.arguments])
        if len(given) < kind.arguments:
            expected = f"expected {kind.arguments} values, got {len(given)}"
            problem = f"{kind.name}: {expected}; give them in the line of the command"
            yield Command(None, given, separator, INVALID, problem)
            return
        yield Command(kind, given, separator)
        rest = words[kind.arguments] if len(words) > kind.arguments else ""
        place = len(text) - len(rest) if kind.arguments else word.end()


def number(word: str) -> float:
    """Return a number, with a point or a comma.

    Raises:
        ValueError: it is none, or not finite.
    """
    try:
        found = float(word.replace(",", ".", 1)) if "_" not in word else math.nan
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise ValueError(f"expected a number as in 12.5, got {word[:_SHOWN]!r}")
    return found


def rounding(word: str) -> float:
    """Return half a unit of the last digit of a number.

    >>> rounding("12.3")
    0.05
    """
    return 0.5 * 0.1 ** len(word.replace(",", ".").partition(".")[2])


def failed(command: Command, code: int) -> str:
    """Return the answer to a command that failed with a positive *code*."""
    return f"{_head(command)}RPRT -{code}\n"


def answered(command: Command, values: Mapping[str, str] | None = None) -> str:
    """Return the answer to a command that was carried out.

    Args:
        command: the command.
        values: by their names; of some commands the name only shows in an extended answer.
    """
    if values is None:
        return f"{_head(command)}RPRT 0\n"
    if command.kind is not None and command.kind.name == "dump_state":
        return _state(command, values)
    if not command.separator:
        is_table = command.kind is not None and command.kind.name == "dump_caps"
        return "".join(
            f"{name}:\t{value}\n" if is_table else f"{value}\n" for name, value in values.items()
        )
    said = "".join(f"{name}: {value}{command.separator}" for name, value in values.items())
    return f"{_head(command)}{said}RPRT 0\n"


def _state(command: Command, values: Mapping[str, str]) -> str:
    """Return what a client of Hamlib reads when it connects: two numbers, then settings."""
    (_, version), (_, model), *settings = values.items()
    said = "".join(f"{name}={value}\n" for name, value in settings)
    end = "RPRT 0\n" if command.separator else ""
    return f"{_head(command)}{version}\n{model}\n{said}done\n{end}"


def _head(command: Command) -> str:
    if not command.separator or command.kind is None:
        return ""
    return f"{' '.join((command.kind.name + ':', *command.arguments))}{command.separator}"
