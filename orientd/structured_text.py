"""Read YAML or JSON strictly, and write it: plain values only, every key once, errors with lines.

PyYAML's own safe loader lets the later of two equal keys win, reads ``1:30`` as ninety and ``010``
as eight, and with libyaml a deeply nested file takes the whole process down.  Here values are put
together from the parser's events: a repeated key is refused, and what is not plainly a number stays
a text, for whoever expected a number to refuse with the field's name.

That is why a reader of our own stands here.  5,000 keyframes take it 0.1 s, PyYAML's loader on
libyaml 0.5 s, its loader in Python 3.4 s and ruamel.yaml 7 s.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from orientd.errors import RequestError
from orientd.files import MEBIBYTE, MOST_BYTES, MOST_VALUES, file_content, written
from orientd.model.plain import joined

Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_HINTS = {
    "expected ',' or": "put commas between entries, and close the brackets",
    "could not find expected ':'": "write KEY: VALUE",
    "mapping values are not allowed": "put texts with a colon in quotes, and line up the keys",
    "expected <block end>": "line up the entries of a list, and the keys",
    "cannot start any token": "put this text in quotes",
    "unexpected end of stream": "close the quotes",
}
"""Words of a problem of YAML, and what to do."""

DEEPEST = 64
"""Levels of nesting that are read; a motion file has five."""

FREE_VALUES = 100_000
"""Of a short file, whose aliases may repeat more values than it has bytes."""

_INT = re.compile(r"[-+]?(0|[1-9][0-9]*)\Z")
_FLOAT = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\Z")
_WORDS: dict[str, float | bool | None] = {
    **dict.fromkeys(("", "~", "null"), None),
    **dict.fromkeys(("true", "yes", "on"), True),
    **dict.fromkeys(("false", "no", "off"), False),
    **dict.fromkeys((".inf", "+.inf"), math.inf),
    "-.inf": -math.inf,
    ".nan": math.nan,
}
_PREFIX = "tag:yaml.org,2002:"


def read_structured(path: Path) -> object:
    """Return the content of a YAML or JSON file.

    Raises:
        RequestError: it cannot be read, has more than :data:`~orientd.files.MOST_BYTES`, is neither
            YAML nor JSON, is empty, or has a key twice.
    """
    return parse_structured(file_content(path), str(path))


def parse_structured(content: bytes, source: str) -> object:
    """Return what the *content* of a YAML or JSON file says.

    Args:
        content: the file's bytes.
        source: the file's name, for errors; one that ends in ``.json`` must be JSON.

    Raises:
        RequestError: it is neither YAML nor JSON, is empty, has a key twice, or more values than
            are read.
    """
    if len(content) > MOST_BYTES:
        raise RequestError("", f"{source}: more than {MOST_BYTES // MEBIBYTE} MiB")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise RequestError(
            "", f"{source}: not UTF-8 text (byte {error.start}); save it as UTF-8"
        ) from error
    if not text.strip():
        raise RequestError("", f"{source}: the file is empty")
    # YAML reads JSON too, a hundred times as slowly.
    if text.lstrip().startswith("{"):
        # Before there are any: each but the first follows one of these.
        if sum(map(text.count, ",[{")) > MOST_VALUES:
            raise RequestError("", f"{source}: more than {MOST_VALUES} values")
        try:
            return json.loads(text, object_pairs_hook=_once)
        except RequestError as error:
            error.args = (f"{source}: {error}",)
            raise
        except RecursionError as error:
            raise RequestError("", f"{source}: nested too deeply") from error
        except json.JSONDecodeError as error:
            if source.endswith(".json"):
                raise RequestError(
                    "", f"{source}: line {error.lineno}: not JSON: {error.msg}"
                ) from error
        except ValueError as error:  # a whole number of thousands of digits
            raise RequestError("", f"{source}: not JSON: {error}") from error
    return _read_yaml(text, source)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        seen: set[str] = set()
        for name, _ in pairs:
            if name in seen:
                raise RequestError(name, "the key is given twice; keep one")
            seen.add(name)
    return mapping


def _read_yaml(text: str, source: str) -> object:
    try:
        loader = Loader(text)
        try:
            return _Reader(loader.get_event, min(MOST_VALUES, max(FREE_VALUES, len(text)))).read()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        problem = error.problem or error.context or "cannot be read"
        lines = text.split("\n")
        if mark and mark.line < len(lines) and lines[mark.line][mark.column :].startswith("\t"):
            problem = "a tab; YAML is indented with spaces"
        hint = next((f"; {hint}" for word, hint in _HINTS.items() if word in problem), "")
        raise RequestError("", f"{source}: {line}not YAML: {problem}{hint}") from error
    except yaml.YAMLError as error:
        raise RequestError("", f"{source}: not YAML: {' '.join(str(error).split())}") from error
    except RequestError as error:
        error.args = (f"{source}: {error}",)
        raise
    except _EmptyError:
        raise RequestError("", f"{source}: the file is empty") from None


class _EmptyError(Exception):
    """There is no document."""


class _Reader:
    """Puts the events of one YAML document together to plain values."""

    def __init__(self, events: Callable[[], Any], most_values: int) -> None:
        self._next, self._most = events, most_values
        # What an anchor names, and how many values that are; nothing yet while it is being read.
        self._anchors: dict[str | None, tuple[Any, int] | None] = {}

    def read(self) -> object:
        self._next()  # the stream begins
        if not isinstance(self._next(), yaml.DocumentStartEvent):
            raise _EmptyError
        content, _ = self._value(self._next(), 0)
        self._next()  # the document ends
        event = self._next()
        if not isinstance(event, yaml.StreamEndEvent):
            raise _problem("another document begins", event)
        if content is None:
            raise _EmptyError
        return content

    def _value(self, event: Any, depth: int) -> tuple[Any, int]:  # noqa: ANN401 - PyYAML has no types
        """Return what begins with *event*, and of how many values it consists."""
        if isinstance(event, yaml.ScalarEvent):
            found: tuple[Any, int] = _scalar(event), 1
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchors:
                raise _wrong(f"nothing before is named &{event.anchor}; quote texts with *", event)
            named = self._anchors[event.anchor]
            if named is None:
                raise _wrong("contains itself", event)
            return named
        else:
            if depth == DEEPEST:
                raise _problem("nested too deeply", event)
            self._anchors[event.anchor] = None
            is_list = isinstance(event, yaml.SequenceStartEvent)
            if event.tag not in (None, "!", f"{_PREFIX}{'seq' if is_list else 'map'}"):
                raise _wrong(f"the tag {event.tag} is not allowed", event)
            found = self._list(depth + 1) if is_list else self._mapping(depth + 1)
        if event.anchor is not None:
            self._anchors[event.anchor] = found
        return found

    def _list(self, depth: int) -> tuple[list[Any], int]:
        content: list[Any] = []
        size = 1
        try:
            while not isinstance(event := self._next(), yaml.SequenceEndEvent):
                value, more = self._value(event, depth)
                size = self._grown(size + more, event)
                content.append(value)
        except RequestError as error:
            field = joined(f"[{len(content)}]", error.field)
            raise RequestError(field, error.problem) from None
        return content, size

    def _mapping(self, depth: int) -> tuple[dict[str, Any], int]:
        content: dict[str, Any] = {}
        size = 1
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                raise _wrong("a key must be a text", event)
            key = event.value
            if key in content:
                raise RequestError(
                    key, f"the key is given twice, again on line {_line(event)}; keep one"
                )
            try:
                content[key], more = self._value(self._next(), depth)
            except RequestError as error:
                raise RequestError(joined(key, error.field), error.problem) from None
            size = self._grown(size + more, event)
        return content, size

    def _grown(self, size: int, event: Any) -> int:  # noqa: ANN401 - as above
        if size > self._most:
            raise _problem(f"more than {self._most} values", event)
        return size


def _scalar(event: Any) -> Any:  # noqa: ANN401 - as above
    text: str = event.value
    if event.tag not in (None, "!", f"{_PREFIX}str"):
        raise _wrong(f"the tag {event.tag} is not allowed", event)
    if event.tag is not None or not event.implicit[0]:
        return text
    if _FLOAT.match(text):
        return float(text)
    if _INT.match(text):
        # Python refuses to read thousands of digits as a whole number.
        return int(text) if len(text) < 300 else float(text)
    return _WORDS.get(text.lower(), text)


def _wrong(problem: str, event: Any) -> RequestError:  # noqa: ANN401 - as above
    """Return the error for a value; whoever knows its place puts that in front."""
    return RequestError("", f"line {_line(event)}: {problem}")


def _line(event: Any) -> int:  # noqa: ANN401 - as above
    return int(event.start_mark.line) + 1


def _problem(problem: str, event: Any) -> Exception:  # noqa: ANN401 - as above
    """Return the error for a whole file."""
    error: Exception = yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)
    return error


def write_structured(path: Path, mapping: Mapping[str, Any]) -> None:
    """Write a mapping of plain values as YAML, or as JSON where the name ends in ``.json``.

    Raises:
        OrientdError: the file cannot be written.
    """
    is_json = path.suffix == ".json"
    text = (
        json.dumps(mapping, indent=1) + "\n" if is_json else "".join(map(_in_yaml, mapping.items()))
    )
    with written(path) as file:
        file.write_text(text, encoding="utf-8")


def _in_yaml(entry: tuple[str, Any]) -> str:
    """Return a key and its value, each of a list of mappings on a line of its own."""
    key, value = entry
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return f"{key}:\n" + "".join(f"  - {_on_one_line(one)}\n" for one in value)
    return f"{key}: {_on_one_line(value)}\n"


def _on_one_line(value: object) -> str:
    written: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=math.inf, allow_unicode=True
    )
    # A value that is no list and no mapping is a document of its own, with its end.
    return written.removesuffix("\n").removesuffix("\n...")
