"""Read YAML or JSON strictly, and write it: plain values only, every key once, errors with lines.

PyYAML's own safe loader lets the later of two equal keys win, reads ``1:30`` as ninety and ``010``
as eight, and with libyaml a deeply nested file takes the whole process down.  Here values are put
together from the parser's events: a repeated key is refused, and what is not plainly a number stays
a text, for whoever expected a number to refuse with the field's name.

That is why a reader of our own stands here.  5,000 keyframes take it 0.2 s, PyYAML's loader on
libyaml 0.7 s, its loader in Python 3.4 s and ruamel.yaml 7 s; 200,000 opening brackets are refused
with their line, and are a segmentation fault of the second.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import yaml

from orientd.bounded_file import MEBIBYTE, read_bounded
from orientd.errors import RequestError
from orientd.whole_file import written

Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

DEEPEST = 64
"""Levels of nesting that are read; a motion file has five."""

MOST_BYTES = 8 * MEBIBYTE
"""Of a file; a keyframe takes about a hundred."""

MOST_VALUES = 1_000_000
"""Values that are read, those repeated by aliases included; each takes up to a hundred bytes."""

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
        RequestError: it cannot be read, has more than :data:`MOST_BYTES`, is neither YAML nor JSON,
            is empty, or has a key twice.
    """
    try:
        content = read_bounded(path, MOST_BYTES)
    except OSError as error:
        raise RequestError("", f"cannot read {path}: {error.strerror}") from error
    return parse_structured(content, str(path))


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
        raise RequestError("", f"{source}: not UTF-8 text (byte {error.start})") from error
    if not text.strip():
        raise RequestError("", f"{source}: the file is empty")
    # YAML reads JSON too, a hundred times as slowly.
    if text.lstrip().startswith("{"):
        # Before there are any: each but the first follows one of these.
        if sum(map(text.count, ",[{")) > MOST_VALUES:
            raise RequestError("", f"{source}: more than {MOST_VALUES} values")
        try:
            return json.loads(text, object_pairs_hook=_once)
        except RequestError:
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
                raise RequestError(name, "the key is given twice")
            seen.add(name)
    return mapping


def _read_yaml(text: str, source: str) -> object:
    most = min(MOST_VALUES, max(FREE_VALUES, len(text)))
    try:
        loader = Loader(text)
        try:
            return _Reader(source, most).read(iter(loader.get_event, None))
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        problem = error.problem or error.context or "cannot be read"
        raise RequestError("", f"{source}: {line}not YAML: {problem}") from error
    except yaml.YAMLError as error:
        raise RequestError("", f"{source}: not YAML: {' '.join(str(error).split())}") from error


@dataclass(slots=True)
class _Level:
    """A list or mapping that is being read, with the key its next value belongs to."""

    content: Any
    anchor: str | None
    key: str | None = None
    size: int = 1


@dataclass(slots=True)
class _Reader:
    """Puts the events of one YAML document together to plain values."""

    _source: str
    _most_values: int
    _levels: list[_Level] = field(default_factory=list)
    _anchors: dict[str, tuple[Any, int]] = field(default_factory=dict)
    _roots: list[Any] = field(default_factory=list)

    def read(self, events: Iterator[Any]) -> object:
        for event in events:
            if isinstance(event, yaml.ScalarEvent):
                level = self._levels[-1] if self._levels else None
                if level is not None and level.key is None and isinstance(level.content, dict):
                    self._open_key(level, event)
                    continue
                self._add(self._scalar(event), 1, event.anchor)
            elif isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent)):
                self._open(event)
            elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
                closed = self._levels.pop()
                self._add(closed.content, closed.size, closed.anchor)
            elif isinstance(event, yaml.AliasEvent):
                self._add(*self._aliased(event))
            elif isinstance(event, yaml.DocumentStartEvent) and self._roots:
                raise RequestError(
                    "", f"{self._source}: line {_line(event)}: not YAML: another document begins"
                )
        if not self._roots or self._roots[0] is None:
            raise RequestError("", f"{self._source}: the file is empty")
        root: object = self._roots[0]
        return root

    def _open(self, event: Any) -> None:  # noqa: ANN401 - PyYAML has no types
        self._refuse_as_key(event)
        is_sequence = isinstance(event, yaml.SequenceStartEvent)
        if event.tag not in (None, "!", f"{_PREFIX}{'seq' if is_sequence else 'map'}"):
            self._refuse(f"the tag {event.tag} is not allowed", event)
        if len(self._levels) == DEEPEST:
            raise RequestError("", f"{self._source}: line {_line(event)}: nested too deeply")
        if event.anchor is not None:
            self._anchors.pop(event.anchor, None)
        self._levels.append(_Level([] if is_sequence else {}, event.anchor))

    def _open_key(self, level: _Level, event: Any) -> None:  # noqa: ANN401 - as above
        key: str = event.value
        is_repeated = key in level.content
        level.key = key
        if is_repeated:
            raise RequestError(
                self._place(), f"the key is given twice, again on line {_line(event)}"
            )

    def _add(self, content: Any, size: int, anchor: str | None = None) -> None:  # noqa: ANN401 - whatever a file holds
        if anchor is not None:
            self._anchors[anchor] = content, size
        if not self._levels:
            self._roots.append(content)
            return
        level = self._levels[-1]
        level.size += size
        if level.size > self._most_values:
            raise RequestError("", f"{self._source}: more than {self._most_values} values")
        if isinstance(level.content, list):
            level.content.append(content)
        else:
            level.content[level.key] = content
            level.key = None

    def _aliased(self, event: Any) -> tuple[Any, int]:  # noqa: ANN401 - as above
        self._refuse_as_key(event)
        if any(level.anchor == event.anchor for level in self._levels):
            self._refuse("contains itself", event)
        if event.anchor not in self._anchors:
            self._refuse(f"nothing before is named &{event.anchor}", event)
        return self._anchors[event.anchor]

    def _scalar(self, event: Any) -> Any:  # noqa: ANN401 - as above
        text: str = event.value
        if event.tag not in (None, "!", f"{_PREFIX}str"):
            self._refuse(f"the tag {event.tag} is not allowed", event)
        if event.tag is not None or not event.implicit[0]:
            return text
        if _FLOAT.match(text):
            return float(text)
        if _INT.match(text):
            # Python refuses to read thousands of digits as a whole number.
            return int(text) if len(text) < 300 else float(text)
        return _WORDS.get(text.lower(), text)

    def _refuse_as_key(self, event: Any) -> None:  # noqa: ANN401 - as above
        level = self._levels[-1] if self._levels else None
        if level is not None and isinstance(level.content, dict) and level.key is None:
            self._refuse("a key must be a text", event)

    def _refuse(self, problem: str, event: Any) -> NoReturn:  # noqa: ANN401 - as above
        raise RequestError(self._place(), f"line {_line(event)}: {problem}")

    def _place(self) -> str:
        """Return the path of the value that is being read."""
        place = ""
        for level in self._levels:
            if isinstance(level.content, list):
                place += f"[{len(level.content)}]"
            elif level.key is not None:
                place += f".{level.key}" if place else level.key
        return place


def _line(event: Any) -> int:  # noqa: ANN401 - PyYAML has no types
    return int(event.start_mark.line) + 1


def write_structured(path: Path, mapping: Mapping[str, Any]) -> None:
    """Write a mapping of plain values as YAML, or as JSON where the name ends in ``.json``.

    Raises:
        OrientdError: the file cannot be written.
    """
    is_json = path.suffix == ".json"
    text = json.dumps(mapping, indent=1) + "\n" if is_json else structured(mapping)
    with written(path) as file:
        file.write_text(text, encoding="utf-8")


def structured(mapping: Mapping[str, Any]) -> str:
    """Return a mapping of plain values as YAML, each of a list of mappings on a line of its own."""
    return "".join(map(_in_yaml, mapping.items()))


def _in_yaml(entry: tuple[str, Any]) -> str:
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
