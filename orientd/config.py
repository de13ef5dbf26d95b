"""The daemon's settings: one TOML file, every key checked, unknown keys refused.

.. code-block:: toml

    [daemon]
    lease_seconds = 5.0

    [devices.arm]
    driver = "loopback"
    rate_hz = 500

    [devices.arm.limits]
    velocity = 2.5
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from orientd.bounded_file import MEBIBYTE, read_bounded
from orientd.errors import ConfigError, RequestError
from orientd.fleet_settings import FleetSettings
from orientd.limit_field import AngularLimit, LinearLimit
from orientd.one_line import one_line
from orientd.operation_settings import (
    AccessSettings,
    MetricsSettings,
    PlannerSettings,
    SomePath,
    Table,
    TcpSettings,
)
from orientd.spelling import unknown_key

if TYPE_CHECKING:
    from orientd.planner import Frame, Limits

NANOSECONDS = 1_000_000_000
MAX_RATE_HZ = 4000.0
LONGEST_LEAD = 1.0
"""s."""
SPIN_US = 50
"""Spun before a deadline unless a device says otherwise, us: 2.5 % of a core at 500 Hz."""
FIRST_PHASE = 5 / 16
"""Phase of the first device: beside whole milliseconds, where the kernel's own timers are."""


_EXPECTED = {
    "too_short": "at least one table [devices.NAME]",
    "string_pattern_mismatch": "a letter, then at most 31 letters, digits, '-' or '_'",
    "is_instance_of": "a path",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
}


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class DaemonSettings(Table):
    """The table ``[daemon]``.

    Attributes:
        socket: where to listen; ``None`` is the user's runtime directory.
        lease_seconds: how long a lease lasts when its holder does not renew it, s.
        log_level: of what is logged.
    """

    socket: SomePath | None = None
    lease_seconds: Annotated[float, Field(ge=0.2, le=3600.0)] = 5.0
    log_level: Literal["debug", "info", "warning", "error"] = "info"


class RecorderSettings(Table):
    """The table ``[recorder]``: the flight recorder, which writes a file on every fault.

    Attributes:
        directory: where to; ``None`` is ``orientd/recordings`` in the user's state directory.
        seconds: that are kept in memory and written, 0 for no flight recorder at all; a device
            takes 344 bytes a cycle, 10 MB for 60 s at 500 Hz.
        keep_files: how many files are kept, the newest.
        keep_megabytes: how large they may be altogether.
    """

    directory: SomePath | None = None
    seconds: Annotated[float, Field(ge=0.0, le=600.0)] = 60.0
    keep_files: Annotated[int, Field(ge=1, le=100_000)] = 20
    keep_megabytes: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 200.0


class LimitSettings(Table):
    """The table ``[devices.NAME.limits]``; what is not given is the default of the planner.

    The angular ones are limits of a norm, or of three components in the body frame.

    Attributes:
        preset: name of published limits, which the others of this table override.
        velocity: largest angular velocity, rad/s.
        acceleration: largest angular acceleration, rad/s^2.
        jerk: largest angular jerk, rad/s^3.
        linear_velocity: largest velocity of the position, m/s.
        linear_acceleration: largest acceleration of the position, m/s^2.
    """

    preset: str | None = None
    velocity: AngularLimit | None = None
    acceleration: AngularLimit | None = None
    jerk: AngularLimit | None = None
    linear_velocity: LinearLimit | None = None
    linear_acceleration: LinearLimit | None = None

    @field_validator("preset")
    @classmethod
    def _know_preset(cls, name: str | None) -> str | None:
        if name is not None:
            from orientd.planner import PRESETS

            if name not in PRESETS:
                raise PydanticCustomError("preset", "one of " + ", ".join(PRESETS))
        return name

    def to_limits(self) -> Limits:
        """Return the planner's limits: what is given here, preset or defaults for the rest."""
        # A file of settings can be read and checked without loading NumPy.
        from orientd.planner import DEFAULT_LIMITS, PRESETS

        given = self.model_dump(exclude_none=True, exclude={"preset"})
        base = DEFAULT_LIMITS if self.preset is None else PRESETS[self.preset].limits
        return base.with_rates(given)


class DeviceSettings(Table):
    """The table ``[devices.NAME]``.

    Attributes:
        name: the key of the table.
        driver: name of the driver in the registry.
        rate_hz: cycles a second.
        auto_enable: enable at start and after a reset.
        heartbeat_timeout: the servo stops when it has not heard the daemon for so long, s.
        feedback_timeout: feedback older than this is a fault, s.
        stall_timeout: a servo process that did not run for longer in motion is a fault, s; after
            a shorter time the motion goes on from rest.
        phase: where in a period its cycles begin, as a share of it from 0 to below 1, on the
            machine's monotonic clock.  Without it devices are spread over the period, so that not
            all want the processor at once; those with the same number have their cycles together.
        spin_us: the last part of the wait for a deadline that is spent spinning, microseconds.
        priority: SCHED_FIFO priority asked for; 0 asks for none.
        compensate_latency: s by which setpoints lead the path time that is reported, so that the
            device is where the plan says; ``true`` for *latency*.
        latency: s that the device is behind its setpoints, as `orientd doctor` has found it.
        limits: what no motion of this device may exceed.
        frames: that motions may name, each with ``base`` and ``tool`` as in a motion file.
        options: the driver's own table.
    """

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,31}$")
    driver: str
    rate_hz: Annotated[float, Field(ge=1.0, le=MAX_RATE_HZ)] = 500.0
    auto_enable: bool = True
    heartbeat_timeout: Positive = 1.0
    feedback_timeout: Positive = 0.1
    stall_timeout: Positive = 0.5
    phase: Annotated[float, Field(ge=0.0, lt=1.0)] = FIRST_PHASE
    spin_us: Annotated[int, Field(ge=0, le=1000)] = SPIN_US
    priority: Annotated[int, Field(ge=0, le=99)] = 80
    compensate_latency: bool | float = False
    latency: float | None = None
    limits: LimitSettings = LimitSettings()
    frames: dict[str, Any] = Field(default_factory=dict)
    options: dict[str, Any] = Field(default_factory=dict)

    @field_validator("compensate_latency", "latency", mode="before")
    @classmethod
    def _check_seconds(cls, given: object, checked: ValidationInfo) -> object:
        may_switch = checked.field_name == "compensate_latency"
        if isinstance(given, bool):
            is_allowed = may_switch
        else:
            is_allowed = isinstance(given, (int, float)) and 0.0 <= given <= LONGEST_LEAD
        if not is_allowed:
            switch = ", or true or false" if may_switch else ""
            raise ValueError(
                f"devices.{checked.data.get('name')}.{checked.field_name}: expected a number of "
                f"seconds from 0 to {LONGEST_LEAD:g}{switch}, got {given!r}"
            )
        return given

    @model_validator(mode="after")
    def _need_latency(self) -> DeviceSettings:
        if self.compensate_latency is True and self.latency is None:
            raise ValueError(
                f"devices.{self.name}.compensate_latency: true needs latency, in seconds; "
                f"`orientd doctor --config FILE --latency {self.name}` finds it"
            )
        return self

    @model_validator(mode="after")
    def _read_frames(self) -> DeviceSettings:
        try:
            self.to_frames()
        except RequestError as error:
            raise ValueError(
                f"devices.{self.name}.frames.{error.field}: {error.problem}"
            ) from error
        return self

    def to_frames(self) -> Mapping[str, Frame]:
        """Return the frames as the planner has them.

        Raises:
            RequestError: one is not well formed.
        """
        if not self.frames:
            return {}
        # As with the limits, what needs NumPy is loaded when there is something for it.
        from orientd.planner import named_frames
        from orientd.schema import read_frames

        return dict(named_frames(read_frames(self.frames)))

    @property
    def lead(self) -> float:
        """By how much what is sent leads the path time that is reported, s."""
        if self.compensate_latency is True:
            return self.latency or 0.0
        return float(self.compensate_latency)

    @property
    def period_ns(self) -> int:
        """Length of a cycle in nanoseconds."""
        return round(NANOSECONDS / self.rate_hz)

    @property
    def phase_ns(self) -> int:
        """Where in a period of the monotonic clock its cycles begin."""
        return int(self.phase * self.period_ns)


class Settings(Table):
    """A whole file.

    Attributes:
        daemon: the table ``[daemon]``.
        recorder: the table ``[recorder]``.
        planner: the table ``[planner]``.
        access: the table ``[access]``.
        tcp: the table ``[tcp]``; without it there is the Unix socket only.
        metrics: the table ``[metrics]``; without it there are none.
        fleet: the table ``[fleet]``; without it the daemon is alone.
        devices: the tables ``[devices.NAME]`` by name.
    """

    daemon: DaemonSettings = DaemonSettings()
    recorder: RecorderSettings = RecorderSettings()
    planner: PlannerSettings = PlannerSettings()
    access: AccessSettings = AccessSettings()
    tcp: TcpSettings | None = None
    metrics: MetricsSettings | None = None
    fleet: FleetSettings | None = None
    devices: Annotated[dict[str, DeviceSettings], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _name_devices(cls, table: object) -> object:
        if not isinstance(table, Mapping) or not isinstance(table.get("devices"), Mapping):
            return table
        named: dict[str, object] = {}
        phases = _spread()
        for name, device in table["devices"].items():
            if isinstance(device, Mapping) and "name" in device:
                raise ValueError(f"devices.{name}.name: the table's own name is the device's name")
            if isinstance(device, Mapping):
                phase = {} if "phase" in device else {"phase": next(phases)}
                device = {**phase, **device, "name": name}
            named[name] = device
        return {**table, "devices": named}


def _spread() -> Iterator[float]:
    """Yield phases that are spread over a period as evenly as can be, however many are taken.

    The sequence of van der Corput (1935) in base 2, so that a device that is added at the end of a
    configuration leaves the others where they are.
    """
    for number in count():
        bits = f"{number:b}"[::-1]
        yield (FIRST_PHASE + int(bits, 2) / 2 ** len(bits)) % 1.0


def default_settings() -> Settings:
    """Return what the daemon runs with when there is no file: one loopback device, ``arm``."""
    return parse({"devices": {"arm": {"driver": "loopback"}}}, source="default settings")


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
    try:
        text = read_bounded(path, MEBIBYTE).decode("utf-8")
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start})") from error
    try:
        table = tomllib.loads(text)
    # Numbers and dates out of range are a ValueError of another kind.
    except ValueError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from error
    except RecursionError as error:
        raise ConfigError(f"{path}: not TOML: nested too deeply") from error
    return parse(table, source=str(path))


def parse(table: Mapping[str, Any], *, source: str) -> Settings:
    """Check *table*, which came from *source* (for the message only).

    Raises:
        ConfigError: a key is unknown, missing or not allowed.
    """
    try:
        return Settings.model_validate(table)
    except ValidationError as error:
        raise ConfigError(one_line(f"{source}: {_describe(error)}")) from error


def _known_keys(table: Sequence[str]) -> list[str]:
    """Return the keys of a table of the file."""
    match table:
        case []:
            return list(Settings.model_fields)
        case ["devices", _]:
            return [key for key in DeviceSettings.model_fields if key != "name"]
        case ["devices", _, _]:
            return list(LimitSettings.model_fields)
    kind = Settings.model_fields[table[0]].annotation
    (model,) = (part for part in (kind, *get_args(kind)) if hasattr(part, "model_fields"))
    return list(model.model_fields)


_LONGEST_KEY = 60
"""Characters of a key that are shown."""


def _describe(error: ValidationError) -> str:
    """Return the first complaint on one line: key, what was expected, what came."""
    first, *others = error.errors(include_url=False)
    if first["type"] == "missing":
        # A misspelt key says more than that the right one is missing.
        first = next((one for one in others if one["type"] == "extra_forbidden"), first)
    place = [str(part)[:_LONGEST_KEY] for part in first["loc"] if part != "[key]"]
    key = ".".join(place)
    came = first["input"]
    if first["type"] == "extra_forbidden":
        *table, last = place
        return f"{key}: {unknown_key(last, _known_keys(table))}"
    if first["type"] == "missing":
        return f"{key}: missing"
    if first["type"] == "value_error":
        return str(first["ctx"]["error"])
    if first["type"] in ("model_type", "model_attributes_type", "dict_type"):
        return f"{key}: expected a table, got {came!r}"
    if isinstance(came, float) and not math.isfinite(came):
        return f"{key}: expected a finite number, got {came!r}"
    expected = _EXPECTED.get(first["type"]) or first["msg"].removeprefix("Input should be ")
    return f"{key}: expected {expected}, got {came!r}"
