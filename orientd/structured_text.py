"""Read YAML or JSON strictly: plain values only, every key once, and errors with their line.

PyYAML's own safe loader lets the later of two equal keys win, and reads ``1:30`` as ninety and
``010`` as eight.  Here a repeated key is refused, and what is not plainly a number stays a text,
for whoever expected a number to refuse with the field's name.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from orientd.errors import RequestError

Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_INT = re.compile(r"[-+]?(0|[1-9][0-9]*)\Z")
_FLOAT = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\Z")
_WORDS = {
    ".inf": math.inf,
    "+.inf": math.inf,
    "-.inf": -math.inf,
    ".nan": math.nan,
}
_TRUE = frozenset({"yes", "true", "on"})
_PREFIX = "tag:yaml.org,2002:"


def read_structured(path: Path) -> object:
    """Return the content of a YAML or JSON file.

    Raises:
        RequestError: it cannot be read, is neither YAML nor JSON, is empty, or has a key twice.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise RequestError("", f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RequestError("", f"{path}: not UTF-8 text (byte {error.start})") from error
    if not text.strip():
        raise RequestError("", f"{path}: the file is empty")
    # YAML reads JSON too, a hundred times as slowly.
    if text.lstrip().startswith("{"):
        try:
            return json.loads(text, object_pairs_hook=_once)
        except RecursionError as error:
            raise RequestError("", f"{path}: nested too deeply") from error
        except json.JSONDecodeError as error:
            if path.suffix == ".json":
                raise RequestError(
                    "", f"{path}: line {error.lineno}: not JSON: {error.msg}"
                ) from error
    return _read_yaml(text, str(path))


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise RequestError(twice, "the key is given twice")
    return mapping


def _read_yaml(text: str, source: str) -> object:
    loader = Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            raise RequestError("", f"{source}: the file is empty")
        return _Reader().value(node, "")
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        problem = error.problem or error.context or "cannot be read"
        raise RequestError("", f"{source}: {line}not YAML: {problem}") from error
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
        raise RequestError("", f"{source}: not YAML: {problem}") from error
    except RecursionError as error:
        raise RequestError("", f"{source}: nested too deeply") from error
    finally:
        loader.dispose()


class _Reader:
    """Turns the nodes of a YAML document into plain values."""

    def __init__(self) -> None:
        self._known: dict[int, Any] = {}
        self._open: set[int] = set()

    def value(self, node: Any, place: str) -> Any:  # noqa: ANN401 - PyYAML has no types
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node, place)
        # An alias is the node it stands for: read once, however often it is mentioned.
        if id(node) in self._known:
            return self._known[id(node)]
        if id(node) in self._open:
            raise RequestError(place, f"line {_line(node)}: contains itself")
        self._open.add(id(node))
        content: Any
        if isinstance(node, yaml.SequenceNode):
            content = [
                self.value(item, f"{place}[{index}]") for index, item in enumerate(node.value)
            ]
        else:
            content = self._mapping(node.value, place)
        if node.tag not in (f"{_PREFIX}seq", f"{_PREFIX}map"):
            raise RequestError(place, f"line {_line(node)}: the tag {node.tag} is not allowed")
        self._open.discard(id(node))
        self._known[id(node)] = content
        return content

    def _mapping(self, pairs: Iterable[tuple[Any, Any]], place: str) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key_node, value_node in pairs:
            if not isinstance(key_node, yaml.ScalarNode):
                raise RequestError(place, f"line {_line(key_node)}: a key must be a text")
            key = key_node.value
            field = f"{place}.{key}" if place else key
            if key in mapping:
                raise RequestError(
                    field, f"the key is given twice, again on line {_line(key_node)}"
                )
            mapping[key] = self.value(value_node, field)
        return mapping


def _line(node: Any) -> int:  # noqa: ANN401 - PyYAML has no types
    return int(node.start_mark.line) + 1


def _scalar(node: Any, place: str) -> Any:  # noqa: ANN401 - PyYAML has no types
    text: str = node.value
    tag: str = node.tag
    if not tag.startswith(_PREFIX):
        raise RequestError(place, f"line {_line(node)}: the tag {tag} is not allowed")
    kind = tag[len(_PREFIX) :]
    if kind == "float":
        if _FLOAT.match(text):
            return float(text)
        return _WORDS.get(text.lower(), text)
    if kind == "int":
        return int(text) if _INT.match(text) else text
    if kind == "bool":
        return text.lower() in _TRUE
    if kind == "null":
        return None
    return text
