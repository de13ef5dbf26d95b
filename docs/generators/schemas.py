"""The references of motion files, the configuration, drivers' options, recordings, metrics."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from generators import words
from orientd.config import DeviceSettings, Settings
from orientd.config.presets import PRESETS
from orientd.daemon.calls.telemetry import Telemetry
from orientd.model.limits import UNITS
from orientd.model.schema import attribute_lines, motion_schema
from orientd.recorder.columns import COLUMNS, FLAGS

_VALUE = re.compile(r"@([a-z_.]+):([A-Z_]+)(?::(\d))?@")

_TABLES = {
    "daemon": "[daemon]",
    "recorder": "[recorder]",
    "planner": "[planner]",
    "access": "[access]",
    "tcp": "[tcp]",
    "metrics": "[metrics]",
    "devices": "[devices.NAME]",
    "limits": "[devices.NAME.limits]",
}


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield one page for each of them."""
    schema = motion_schema()
    yield "reference/motion-file.md", _from(source, "motion-file", "".join(_motion(schema)))
    text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    yield "static/motion-file.schema.json", text
    yield (
        "reference/configuration.md",
        _from(source, "configuration", "".join(_tables())),
    )
    yield "reference/limits.md", _from(source, "limits", "".join(_presets()))
    yield "reference/recording.md", _from(source, "recording", "".join(_columns()))
    yield "reference/metrics.md", _from(source, "metrics", "".join(_metrics()))
    yield "reference/numeric-range.md", _with_values(source / "reference/parts/numeric-range.md")
    for point in entry_points(group="orientd.drivers"):
        name = point.value.partition(":")[0]
        module = next(
            (one for one in (f"{name}.options", f"{name}.driver") if _says_options(one)), None
        )
        if module is None:
            raise ValueError(f"no module of {name} says what its options are")
        text = f"Options of `{point.name}`\n{'=' * 40}\n\n"
        text += f'What ``[devices.NAME.options]`` holds for ``driver = "{point.name}"``.\n\n'
        yield f"reference/drivers/{point.name}.rst", text + _doc(module) + "\n"


def _says_options(module: str) -> bool:
    try:
        return "ptions" in _doc(module)
    except ImportError:
        return False


def _doc(module: str) -> str:
    return inspect.getdoc(import_module(module)) or ""


def _from(source: Path, name: str, made: str) -> str:
    """Return the page that is written by hand with what is made put to its place."""
    text = (source / "reference" / "parts" / f"{name}.md").read_text(encoding="utf-8")
    if text.count("@made@") != 1:
        raise ValueError(f"reference/parts/{name}.md needs one @made@")
    return text.replace("@made@", made)


def _with_values(page: Path) -> str:
    """Return a page with the value of each ``@module:NAME@`` of the code."""
    return _VALUE.sub(_value, page.read_text(encoding="utf-8"))


def _value(named: re.Match[str]) -> str:
    module, name, index = named.groups()
    value = getattr(import_module(module), name)
    value = value if index is None else value[int(index)]
    is_long = isinstance(value, int) or 1.0 <= abs(value) < 1e9
    return f"{value:,.10g}" if is_long else f"{value:g}"


# The motion file


def _motion(schema: Mapping[str, Any]) -> Iterator[str]:
    yield "## The file\n\n"
    yield from _object(schema)
    for name, inner in schema["$defs"].items():
        yield f"\n## {name}\n\n"
        if "oneOf" in inner:
            forms = ", ".join(f"`{one['required'][0]}`" for one in inner["oneOf"])
            yield f"Exactly one of {forms} says the orientation.\n\n"
        yield from _object(inner)


def _object(schema: Mapping[str, Any]) -> Iterator[str]:
    yield "| key | type | meaning |\n|---|---|---|\n"
    for name, inner in schema["properties"].items():
        needed = "; needed" if name in schema["required"] else ""
        default = inner.get("default")
        shown = "" if default in (None, "", {}, []) else f"; default `{json.dumps(default)}`"
        described = words.said(inner.get("description", ""))
        yield f"| `{name}` | {_kind(inner)}{needed}{shown} | {described} |\n"


def _kind(schema: Mapping[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"a [{name}](#{name.lower()})"
    if "anyOf" in schema:
        return " or ".join(_kind(one) for one in schema["anyOf"] if one != {"type": "null"})
    if "enum" in schema:
        return " or ".join(f"`{one}`" for one in schema["enum"] if one is not None)
    if isinstance(schema.get("additionalProperties"), Mapping):
        return f"{_kind(schema['additionalProperties'])} by name"
    if schema["type"] == "array":
        inner = schema["items"]
        if schema.get("minItems") == 3:
            return "3 rows of 3 numbers" if inner["type"] == "array" else "3 numbers"
        each = "numbers" if inner == {"type": "number"} else _kind(inner).removeprefix("a ")
        return f"a list of {each}"
    names = {"number": "a number", "string": "text", "boolean": "`true` or `false`"}
    names |= {"integer": "a whole number", "object": "a table"}
    above = ", above 0" if "exclusiveMinimum" in schema else ""
    return names[schema["type"]] + above


# The configuration


def _tables() -> Iterator[str]:
    """Yield the tables that the daemon reads, then those that packages read."""
    yield from _table(Settings, "")
    for point in sorted(entry_points(group="orientd.tables"), key=lambda one: one.name):
        yield from _table(point.load(), f"[{point.name}]")


def _table(model: type[BaseModel], heading: str) -> Iterator[str]:
    said = attribute_lines(model)
    inner: list[tuple[type[BaseModel], str]] = []
    rows: list[str] = []
    for name, field in model.model_fields.items():
        found = _model_in(field.annotation)
        if found is not None:
            inner.append((found, _TABLES[name]))
            continue
        if name == "name" and model is DeviceSettings:  # the key of its table
            continue
        if name not in said:
            raise ValueError(f"{model.__name__} does not say what {name} is")
        given = field.get_default(call_default_factory=True)
        default = "needed" if field.is_required() else _default(given)
        rows.append(f"| `{name}` | {words.said(said[name])} | {default} |\n")
    if heading:
        yield f"\n## `{heading}`\n\n"
        first = (inspect.getdoc(model) or "").split("\n\nAttributes")[0]
        more = first.partition("\n\n")[2]
        yield f"{words.said(more)}\n\n" if more else ""
    if rows:
        yield "| key | meaning | default |\n|---|---|---|\n"
        yield from rows
    for one, name in inner:
        yield from _table(one, name)


def _model_in(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401 - any type
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(one) for one in get_args(annotation))
    return next((one for one in found if one is not None), None)


def _default(value: object) -> str:
    if value is None or value == {}:
        return ""
    return f"`{json.dumps(value)}`"


def _presets() -> Iterator[str]:
    units = [f"{name}, {unit}" for name, unit in UNITS.items()]
    yield f"| preset | {' | '.join(units)} | source |\n|---|{'---|' * len(units)}---|\n"
    for name, preset in PRESETS.items():
        shown = " | ".join(f"{preset.limits.rate(one):.4g}" for one in UNITS)
        yield f"| `{name}` | {shown} | {preset.source} |\n"


def _columns() -> Iterator[str]:
    yield "| field | type | unit | meaning | step |\n|---|---|---|---|---|\n"
    for one in COLUMNS:
        if one.path:
            step = f"{one.step:.0e}" if one.step else ""
            unit = one.unit.replace("^2", "²")
            yield f"| `{one.path}` | `{one.type}` | {unit} | {one.doc} | {step} |\n"
    for name, (_, doc) in FLAGS.items():
        yield f"| `{name}` | `bool` | | {doc} | |\n"
    yield "\n"


def _metrics() -> Iterator[str]:
    yield "| metric | kind | labels | meaning |\n|---|---|---|---|\n"
    # The registry tells labels of what was counted only; its collectors know them from the first.
    collectors = dict.fromkeys(Telemetry().registry._names_to_collectors.values())  # noqa: SLF001
    for collector in collectors:
        metric = next(iter(collector.describe()))
        name = metric.name + ("_total" if metric.type == "counter" else "")
        labels = ", ".join(f"`{label}`" for label in collector._labelnames)  # noqa: SLF001
        yield f"| `{name}` | {metric.type} | {labels} | {metric.documentation} |\n"
