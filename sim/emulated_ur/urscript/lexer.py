"""Tokens of URScript, and the end of a program in a stream of text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

_WORDS = """
    def thread sec end if elif else while break continue return and or xor not True False global
    local run kill join halt enter_critical exit_critical pass switch
"""
KEYWORDS = frozenset(_WORDS.split())
_OPENING = frozenset({"def", "thread", "sec", "if", "while", "switch"})

_TOKEN = re.compile(
    r"""(?P<blank>[ \t\r]+|\#[^\n]*)
      | (?P<newline>\n)
      | (?P<number>0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)
      | (?P<name>[^\W\d]\w*)
      | (?P<string>"[^"\n]*")
      | (?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:.])
      | (?P<wrong>.)""",
    re.VERBOSE,
)


class ScriptError(Exception):
    """A program that does not compile, or that ends with an exception.

    Attributes:
        line, column: its place, counted from 1; 0 if unknown.
    """

    def __init__(self, text: str, line: int = 0, column: int = 0) -> None:
        super().__init__(text)
        self.line = line
        self.column = column


class Token(NamedTuple):
    """A token: its kind (name, keyword, number, string, sign, newline, end), text and place."""

    kind: str
    text: str
    line: int
    column: int


def tokens(text: str) -> Iterator[Token]:
    """Yield the tokens of a program; line ends inside brackets are left out.

    Raises:
        ScriptError: a character that begins no token.
    """
    line, begin, depth = 1, 0, 0
    for found in _TOKEN.finditer(text):
        kind, word = str(found.lastgroup), found.group()
        column = found.start() - begin + 1
        if kind == "wrong":
            raise ScriptError(f"lexer_error_on_line:{line}: unexpected {word!r}", line, column)
        if kind == "sign":
            depth += (word in "([") - (word in ")]")
        if kind == "newline":
            if depth <= 0:
                yield Token(kind, word, line, column)
            line, begin = line + 1, found.end()
        elif kind != "blank":
            is_keyword = kind == "name" and word in KEYWORDS
            yield Token("keyword" if is_keyword else kind, word, line, column)
    yield Token("end", "", line, len(text) - begin + 1)


class Splitter:
    """Split a client's text into programs: a line, or all from ``def`` to its ``end``."""

    def __init__(self) -> None:
        self._pending = bytearray()
        self._lines: list[str] = []
        self._depth = 0

    def feed(self, chunk: bytes) -> list[str]:
        """Return the programs that *chunk* completes."""
        self._pending += chunk
        *lines, rest = bytes(self._pending).split(b"\n")
        self._pending = bytearray(rest)
        programs = []
        for raw in lines:
            line = raw.decode("utf-8", "replace")
            self._lines.append(line)
            words = [m.group() for m in _TOKEN.finditer(line) if m.lastgroup == "name"]
            self._depth += sum(word in _OPENING for word in words) - words.count("end")
            if self._depth <= 0:
                program = "\n".join(self._lines) + "\n"
                if not re.fullmatch(r"(\s*(#[^\n]*)?\n)*", program):
                    programs.append(program)
                self._lines, self._depth = [], 0
        return programs

    @property
    def unfinished(self) -> str:
        """The text of a program that has not ended yet."""
        return "\n".join([*self._lines, self._pending.decode("utf-8", "replace")]).strip()
