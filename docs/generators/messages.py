"""The reference of errors and faults: cause, cure, and every message of the code.

The messages come from the ``raise`` statements of the sources.  The build fails if an error or a
fault has no cause and cure, or if the guide to common errors quotes a message that is gone.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

from orientd import errors
from orientd.errors import Fault, OrientdError

SOURCES = ("orientd", "adapters", "drivers")
GUIDE = "how-to/troubleshooting.md"
# Modules with errors of their own: their messages stand with the public error above.
MORE_ERRORS = (
    "orientd.client.connection",
    "orientd.planner.refusal",
    "orientd.recorder.reader",
    "orientd_dynamixel.servo",
)

Messages = dict[str, set[str]]

_HOLE = "..."
_FEWEST_LETTERS = 6
_SHORTEST = 7
_QUOTED = re.compile(r"^\| (?:`[a-z_]+` with )?`([^`]* [^`]*)`", re.MULTILINE)


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the page.

    Raises:
        ValueError: an error or a fault has no cause and cure, or a quoted message is gone.
    """
    kinds = {one.__name__ for one in _tree(OrientdError) if one.__module__ == errors.__name__}
    faults = {one.name.lower() for one in Fault if one}
    file = source / "reference" / "parts" / "messages.toml"
    known = tomllib.loads(file.read_text(encoding="utf-8"))
    for name, needed in (("errors", kinds), ("faults", faults)):
        if differing := needed ^ set(known[name]):
            raise ValueError(f"{file.name}: [{name}] differs from the code in {sorted(differing)}")
    trees = [
        ast.parse(path.read_text(encoding="utf-8"))
        for folder in SOURCES
        for path in sorted((source.parent / folder).rglob("*.py"))
    ]
    _check_quotes((source / GUIDE).read_text(encoding="utf-8"), trees)
    found = _messages(trees)
    text = (file.parent / "messages.md").read_text(encoding="utf-8")
    for name in known:
        text = text.replace(f"@{name}@", "".join(_rows(known[name], found)))
    yield "reference/messages.md", text


def _tree(kind: type[OrientdError]) -> Iterator[type[OrientdError]]:
    yield kind
    for one in kind.__subclasses__():
        yield from _tree(one)


def _rows(known: Mapping[str, Mapping[str, str]], messages: Messages) -> Iterator[str]:
    for name, row in known.items():
        yield f"\n### {name}\n\n**Cause.** {row['cause']}\n\n"
        if "servo" in row:
            yield f"**The servo** {row['servo']}.\n\n"
        yield f"**Cure.** {row['cure']}\n\n"
        listed = sorted(messages[name], key=lambda one: one.lstrip(" .:").lower())
        yield from (f"- `` {one} ``\n" for one in listed)


def _messages(trees: list[ast.Module]) -> Messages:
    """Return the messages of the sources, by fault and by the public error that a caller sees."""
    for module in MORE_ERRORS:
        import_module(module)
    named = {
        one.__name__: next(up for up in one.__mro__ if up.__module__ == errors.__name__).__name__
        for one in _tree(OrientdError)
    } | {f"Fault.{one.name}": one.name.lower() for one in Fault}
    found: Messages = defaultdict(set)
    calls = (one for tree in trees for one in ast.walk(tree) if isinstance(one, ast.Call))
    for call in calls:
        given = [ast.unparse(call.func).rpartition(".")[2], *map(ast.unparse, call.args[:1])]
        name = next((named[one] for one in given if one in named), None)
        text = ": ".join(filter(None, map(_text, call.args)))
        if name and len(re.findall(r"[a-z]", text)) >= _FEWEST_LETTERS:
            found[name].add(text)
    return found


def _text(node: ast.expr) -> str:
    """Return a text of the code, with dots for its names and numbers."""
    match node:
        case ast.Constant(str(text)):
            return " ".join(text.split())
        case ast.JoinedStr(parts):
            whole = "".join(
                str(one.value) if isinstance(one, ast.Constant) else _HOLE for one in parts
            )
            return " ".join(re.sub(r"(\.\.\.)+", _HOLE, whole).split())
        case ast.BinOp(left, ast.Add(), right):
            return _text(left) + _text(right)
    return ""


def _check_quotes(guide: str, trees: list[ast.Module]) -> None:
    """Refuse a guide that quotes a message that the code no longer has."""
    constants = {
        " ".join(node.value.replace("`", "").split())
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    texts = {one for one in constants if len(one) >= _SHORTEST}
    for quote in _QUOTED.findall(guide):
        for part in (one.strip() for one in quote.split(_HOLE)):
            if len(part) > _SHORTEST and not any(part in one or one in part for one in texts):
                raise ValueError(f"{GUIDE} quotes {quote!r}: no message of the code has {part!r}")
