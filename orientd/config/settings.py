"""A whole configuration: its place, its tables, and its errors on one line."""

from __future__ import annotations

import logging
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import Field, ModelWrapValidatorHandler, PrivateAttr, ValidationError, model_validator

from orientd.config.devices import FIRST_PHASE, DeviceSettings
from orientd.config.operation import (
    AccessSettings,
    DaemonSettings,
    MetricsSettings,
    PlannerSettings,
    RecorderSettings,
    TcpSettings,
)
from orientd.config.table import SOURCE, Table
from orientd.errors import ConfigError, RequestError
from orientd.files import MEBIBYTE, read_bounded
from orientd.model.refusal import refused
from orientd.one_line import one_line

_log = logging.getLogger(__name__)

_TOML_PLACE = re.compile(r"\(at line (\d+), column \d+\)")
_TOML_HINTS = (
    (re.compile(r"[\w.-]+\s*=\s*[-+]?\d+,\d"), "write numbers with a decimal point"),
    (re.compile(r"[\w.-]+\s*=\s*(yes|no|on|off|True|False)\b"), "write true or false"),
    (re.compile(r"[\w.-]+\s*=\s*[A-Za-z/~]"), "put texts in quotes"),
    (re.compile(r"[\w.-]+\s*=\s*[-+]?\d[\d.]*\s*[A-Za-z°%]"), "write numbers without a unit"),
    (re.compile(r"[\w.-]+:|\{"), "a configuration is TOML: KEY = VALUE below [HEADING]"),
)
"""Lines that are no TOML, and what to write instead."""
_TOML_PROBLEMS = {
    "twice": "give each heading once, and each device a name of its own",
    "overwrite": "give each key once",
    "Duplicate": "give each key once",
    "at end of document": "close the quotes and brackets",
}
"""Words of a problem of TOML, and what to do."""
_SHOWN_LINE = 60
"""Most characters of a line that a message shows."""


RETIRED = {
    "access.streamed_bytes": ", and set message_bytes",
    "access.streamed_keyframes": ", and set keyframes",
    "access.requests_per_second": "",
}
"""Keys of earlier versions, and what else to do than to remove them."""


TABLES = "orientd.tables"
"""Group of entry points: the tables that installed packages read, called as their tables."""


MOVED = {"fleet": "`orientd fleet serve`"}
"""Tables of earlier versions that packages read now, and the commands that do so."""


class Settings(Table):
    """A whole file, without the tables that installed packages read.

    Attributes:
        daemon: the table ``[daemon]``.
        recorder: the table ``[recorder]``.
        planner: the table ``[planner]``.
        access: the table ``[access]``.
        tcp: the table ``[tcp]``; without it there is the Unix socket only.
        metrics: the table ``[metrics]``; without it there are none.
        devices: the tables ``[devices.NAME]`` by name.
    """

    daemon: DaemonSettings = DaemonSettings()
    recorder: RecorderSettings = RecorderSettings()
    planner: PlannerSettings = PlannerSettings()
    access: AccessSettings = AccessSettings()
    tcp: TcpSettings | None = None
    metrics: MetricsSettings | None = None
    devices: Annotated[
        dict[str, DeviceSettings],
        Field(default_factory=dict, min_length=1, validate_default=True),
    ]

    _of_packages: dict[str, str] = PrivateAttr(default_factory=dict)

    @property
    def of_packages(self) -> Mapping[str, str]:
        """Return the tables that installed packages read, each with its reader."""
        return self._of_packages

    @model_validator(mode="wrap")
    @classmethod
    def _leave_out_tables_of_packages(
        cls, table: object, handler: ModelWrapValidatorHandler[Self]
    ) -> Self:
        if not isinstance(table, Mapping) or not table.keys() - cls.model_fields.keys():
            return handler(table)
        from importlib.metadata import entry_points  # slow to load, and few files need it

        packages = {
            entry.name: MOVED.get(entry.name, entry.module.partition(".")[0])
            for entry in entry_points(group=TABLES)
            if entry.name in table and entry.name not in cls.model_fields
        }
        for name, command in MOVED.items():
            if name in table and name not in {*packages, *cls.model_fields}:
                raise RequestError(name, f"{command} reads this table, and is not installed here")
        settings = handler({key: table[key] for key in table if key not in packages})
        settings._of_packages = packages  # noqa: SLF001 - an object of this class
        return settings

    @model_validator(mode="before")
    @classmethod
    def _leave_out_retired(cls, table: object) -> object:
        if not isinstance(table, Mapping):
            return table
        kept = dict(table)
        for name, more in RETIRED.items():
            heading, _, key = name.partition(".")
            if isinstance(kept.get(heading), Mapping) and key in kept[heading]:
                _log.warning("%s is no longer used: remove it%s", name, more)
                kept[heading] = {**kept[heading]}
                del kept[heading][key]
        return kept

    @model_validator(mode="before")
    @classmethod
    def _name_devices(cls, table: object) -> object:
        if not isinstance(table, Mapping) or not isinstance(table.get("devices"), Mapping):
            return table
        named: dict[str, object] = {}
        phases = _spread()
        for name, device in table["devices"].items():
            if isinstance(device, Mapping) and "name" in device:
                problem = "the table's own name is the device's name"
                raise RequestError(f"devices.{name}.name", problem)
            if isinstance(device, Mapping):
                phase = {} if "phase" in device else {"phase": next(phases)}
                rate = {} if "rate_hz" in device else _own_rate(device.get("driver"))
                device = {**phase, **rate, **device, "name": name}
            named[name] = device
        return {**table, "devices": named}


def _own_rate(driver: object) -> dict[str, float]:
    """Return the default cycle rate of a driver; nothing if it is not installed.

    A missing driver is an error only when the device is made.
    """
    # Entry points take milliseconds to look through, which not every command has to.
    from orientd.driver import load_driver

    try:
        return {"rate_hz": load_driver(driver).default_rate_hz} if isinstance(driver, str) else {}
    except ConfigError:
        return {}


def _spread() -> Iterator[float]:
    """Yield phases that are spread evenly over a period, however many are taken.

    The sequence of van der Corput (1935) in base 2, so that a device that is added at the end of a
    configuration leaves the others where they are.
    """
    for number in count():
        bits = f"{number:b}"[::-1]
        yield (FIRST_PHASE + int(bits, 2) / 2 ** len(bits)) % 1.0


def find() -> Path | None:
    """Return the file to use when none is named on the command line.

    ``$ORIENTD_CONFIG``, or else ``orientd/orientd.toml`` in the user's configuration directory
    if it is there, or else ``None``.
    """
    named = os.environ.get("ORIENTD_CONFIG")
    if named:
        return Path(named).expanduser()
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    path = Path(home) / "orientd" / "orientd.toml"
    return path if path.is_file() else None


def load(path: Path) -> Settings:
    """Read the settings in *path*.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or a key is unknown or not allowed; the
            one line names the file, the key, what was expected and what came.
    """
    return parse(read_table(path), source=str(path))


def default_settings() -> Settings:
    """Return what the daemon runs with when there is no file: one loopback device, ``arm``."""
    return parse({"devices": {"arm": {"driver": "loopback"}}}, source="default settings")


def load_or_default(path: Path | None = None) -> Settings:
    """Return the settings in *path*, or in the file to use, or without one the default.

    Raises:
        ConfigError: as for :func:`load`.
    """
    path = path or find()
    return load(path) if path else default_settings()


def read_table(path: Path) -> dict[str, Any]:
    """Return what a TOML file holds.

    Raises:
        ConfigError: it cannot be read, or is not TOML.
    """
    try:
        text = read_bounded(path, MEBIBYTE).decode("utf-8-sig")
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8"
        ) from error
    try:
        return tomllib.loads(text)
    # Numbers and dates out of range are a ValueError of another kind.
    except ValueError as error:
        problem = one_line(f"{path}: not TOML: {error}{_toml_hint(text, str(error))}")
        raise ConfigError(problem) from error
    except RecursionError as error:
        raise ConfigError(f"{path}: not TOML: nested too deeply") from error


def _toml_hint(text: str, problem: str) -> str:
    """Return the line that is no TOML, and what to write instead; empty if the place is unknown."""
    place = _TOML_PLACE.search(problem)
    lines = text.split("\n")
    line = ""
    if place is not None and int(place[1]) <= len(lines):
        line = lines[int(place[1]) - 1].strip()
    hints = [hint for word, hint in _TOML_PROBLEMS.items() if word in problem]
    hints += [hint for form, hint in _TOML_HINTS if form.match(line)]
    hint = f"; {hints[0]}" if hints else ""
    return f": {line[:_SHOWN_LINE]!r}{hint}" if line else hint


Read = TypeVar("Read", bound=Table)


def parse(table: Mapping[str, Any], *, source: str) -> Settings:
    """Check *table*, which came from *source* (for the message only).

    Raises:
        ConfigError: a key is unknown, missing or not allowed.
    """
    return parse_as(Settings, table, source=source)


def parse_as(kind: type[Read], table: Mapping[str, Any], *, source: str) -> Read:
    """Check *table* as settings of another kind, such as those of a package; see :func:`parse`.

    Raises:
        ConfigError: a key is unknown, missing or not allowed.
    """
    try:
        return kind.model_validate(table, context={SOURCE: source})
    except ValidationError as error:
        raise ConfigError(one_line(f"{source}: {refused(error, kind)}")) from error
