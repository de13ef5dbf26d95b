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
from functools import partial

from orientd.one_line import counted

OK, INVALID, TIMEOUT, IO_ERROR, REJECTED, UNAVAILABLE = 0, 1, 5, 6, 9, 11
"""Codes of Hamlib; a negative one answers a command that failed."""

LONGEST = 1024
"""Longest line, bytes."""


NAMES = {
    "P": "set_pos",
    "p": "get_pos",
    "K": "park",
    "S": "stop",
    "R": "reset",
    "M": "move",
    "_": "get_info",
    "s": "get_status",
    "1": "dump_caps",
    "\x8f": "dump_state",
    "q": "quit",
}
"""The served commands, by letter."""

_ARGUMENTS = {"set_pos": 2, "reset": 1, "move": 2}
"""Number of words that follow a command."""
_NOT_SERVED = frozenset("VvUuXxCwLlDdEeBAa3")
_NAMES_NOT_SERVED = frozenset(
    [
        "set_level",
        "get_level",
        "set_func",
        "get_func",
        "set_parm",
        "get_parm",
        "set_conf",
        "get_conf",
        "send_cmd",
        "dump_conf",
        "lonlat2loc",
        "loc2lonlat",
        "dms2dec",
        "dec2dms",
        "dmmm2dec",
        "dec2dmmm",
        "qrb",
        "a_sp2a_lp",
        "d_sp2d_lp",
        "pause",
    ]
)
_SHOWN = 40
"""Most characters of a line that a message shows."""
_UNSERVED = "not served: a device has no levels, functions or parameters; leave it out"
_UNKNOWN = f"unknown command, expected one of {', '.join(NAMES).replace(chr(0x8F), 'dump_state')}"
_LONG = re.compile(r"\w{2,}", re.ASCII)
_WORD = re.compile(r"\\(\w*)|(.)", re.ASCII | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Command:
    """A command of a line, or the error in it.

    Attributes:
        name: the long form; empty for a bad command.
        arguments: the words that follow.
        separator: between the parts of an extended answer; empty for a plain answer.
        error: code of a bad command.
        problem: what is wrong with a bad command, in one line.
    """

    name: str
    arguments: tuple[str, ...] = ()
    separator: str = ""
    error: int = OK
    problem: str = ""


def commands(line: bytes) -> Iterator[Command]:
    r"""Yield the commands of a line; a bad one is the last.

    >>> [one.name for one in commands(b"S;p P 10 20\n")]
    ['stop', 'get_pos', 'set_pos']
    >>> next(commands(b"\\set_pos 10\n")).error
    1
    """
    if len(line) > LONGEST:
        problem = f"a line of more than {LONGEST} bytes; end each command with a line feed"
        yield Command("", error=INVALID, problem=problem)
        return
    text = _text_of(line).rstrip("\r\n\0 \t")
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
        bad = partial(Command, "", separator=separator, error=INVALID)
        word = _WORD.match(text, place)
        if word is None:
            yield bad(problem=f"expected a command after {text[:_SHOWN]!r}")
            return
        name, letter = word.groups()
        long = _LONG.match(text, place)
        if long and long.group() in NAMES.values():
            yield bad(
                problem=f"{long.group()}: a long name needs a backslash; write \\{long.group()}"
            )
            return
        if letter is not None:
            name = NAMES.get(letter.replace("Q", "q"))
        if name not in NAMES.values():
            known = name in _NAMES_NOT_SERVED or letter in _NOT_SERVED
            problem = f"{word.group()[:_SHOWN]!r}: {_UNSERVED if known else _UNKNOWN}"
            yield bad(problem=problem, error=UNAVAILABLE if known else INVALID)
            return
        count = _ARGUMENTS.get(name, 0)
        words = text[word.end() :].split(None, count)
        given = tuple(words[:count])
        if len(given) < count:
            expected = f"expected {counted(count, 'value')}, got {len(given)}"
            problem = f"{name}: {expected}; give them in the line of the command"
            yield bad(given, problem=problem)
            return
        yield Command(name, given, separator)
        rest = words[count] if len(words) > count else ""
        place = len(text) - len(rest) if count else word.end()


def _text_of(line: bytes) -> str:
    """Return the text of a line; a byte that is no UTF-8 is a character of its own."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


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
    if command.name == "dump_state":
        # A client of Hamlib reads this when it connects: two numbers, then settings.
        (_, version), (_, model), *settings = values.items()
        said = "".join(f"{name}={value}\n" for name, value in settings)
        end = "RPRT 0\n" if command.separator else ""
        return f"{_head(command)}{version}\n{model}\n{said}done\n{end}"
    if not command.separator:
        is_table = command.name == "dump_caps"
        return "".join(
            f"{name}:\t{value}\n" if is_table else f"{value}\n" for name, value in values.items()
        )
    said = "".join(f"{name}: {value}{command.separator}" for name, value in values.items())
    return f"{_head(command)}{said}RPRT 0\n"


def _head(command: Command) -> str:
    if not command.separator or not command.name:
        return ""
    return f"{' '.join((command.name + ':', *command.arguments))}{command.separator}"
