"""The tables of devices, and the limits in them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field, PrivateAttr, field_validator, model_validator
from pydantic_core import PydanticCustomError

from orientd.config.table import SOURCE, Name, Positive, Table, checked
from orientd.errors import ConfigError, RequestError
from orientd.model.cones import read_cones
from orientd.model.fields import AngularRate, LinearRate

if TYPE_CHECKING:
    from orientd.driver import Driver
    from orientd.keep_out import KeepOut
    from orientd.model.limits import Limits
    from orientd.model.request import Frame
    from orientd.planner.device_planner import DevicePlanner

NANOSECONDS = 1_000_000_000
MAX_RATE_HZ = 4000.0
LONGEST_LEAD = 1.0
"""s."""
SPIN_US = 50
"""Spun before a deadline unless a device says otherwise, us: 2.5 % of a core at 500 Hz."""
FIRST_PHASE = 5 / 16
"""Phase of the first device: off whole milliseconds, where the kernel's own timers are."""


def _interpreter(path: str) -> str:
    if path and not Path(path).expanduser().is_absolute():
        raise ValueError
    return path and str(Path(path).expanduser())


def _seconds(value: float) -> float:
    if isinstance(value, bool) or not 0.0 <= value <= LONGEST_LEAD:
        raise ValueError
    return value


_SECONDS = f"a number of seconds from 0 to {LONGEST_LEAD:g}"


class LimitSettings(Table):
    """The table ``[devices.NAME.limits]``; the planner has defaults for all of them.

    An angular limit is one number for the norm, or three for the components in the body frame.

    Attributes:
        preset: name of published limits, which the other keys of this table override.
        velocity: largest angular velocity, rad/s.
        acceleration: largest angular acceleration, rad/s^2.
        jerk: largest angular jerk, rad/s^3.
        linear_velocity: largest velocity of the position, m/s.
        linear_acceleration: largest acceleration of the position, m/s^2.
    """

    preset: str | None = None
    velocity: AngularRate = None
    acceleration: AngularRate = None
    jerk: AngularRate = None
    linear_velocity: LinearRate = None
    linear_acceleration: LinearRate = None

    @field_validator("preset")
    @classmethod
    def _know_preset(cls, name: str | None) -> str | None:
        if name is not None:
            from orientd.config.presets import PRESETS

            if name not in PRESETS:
                raise PydanticCustomError("preset", "one of " + ", ".join(PRESETS))
        return name

    def to_limits(self) -> Limits:
        """Return the planner's limits: what is given here, preset or defaults for the rest."""
        # A file of settings can be read and checked without loading NumPy.
        from orientd.config.presets import PRESETS
        from orientd.model.limits import DEFAULT_LIMITS

        given = self.model_dump(exclude_none=True, exclude={"preset"})
        base = DEFAULT_LIMITS if self.preset is None else PRESETS[self.preset].limits
        return base.with_rates(given)


class DeviceSettings(Table):
    """The table ``[devices.NAME]``.

    Attributes:
        name: the key of the table.
        driver: name of the driver.
        python: absolute path of the interpreter of another environment for the servo process, if
            the vendor's packages conflict with those of orientd.  That environment does not need
            orientd.
        rate_hz: cycle rate, Hz; the default depends on the driver: 100 for a gimbal, else 500.
        auto_enable: whether to enable the device at start and after a reset.
        heartbeat_timeout: the servo stops the device if it hears nothing from the daemon for this
            long, s.
        feedback_timeout: largest age of feedback, s; if it is older, the servo stops the device
            with a fault.
        stall_timeout: if the servo process stalls for longer during a motion, that is a fault, s;
            after a shorter stall the motion resumes.
        phase: start of the cycles within the period, 0 to below 1. By default the daemon spreads
            its devices over the period, so that they do not all need the processor at once.
        spin_us: how long before a deadline the servo spins instead of sleeping, microseconds.
        priority: requested SCHED_FIFO priority; 0 requests none.
        compensate_latency: send setpoints earlier by this time, so that the device is where the
            plan says, s; ``true`` for *latency*.
        latency: delay of the device behind its setpoints, as `orientd doctor` measures it, s.
        limits: limits of every motion of this device.
        frames: frames that motions may name, each with ``base`` and ``tool`` as in a motion file.
        keep_out: up to 8 cones that an axis of the tool stays outside of.  Each has a ``name``, a
            direction in the base frame (``direction``, ``azimuth_elevation`` or ``sun``) and a
            ``half_angle_deg``; ``margin_deg`` and ``axis`` are optional.
        options: the driver's own table.
    """

    implied: ClassVar[frozenset[str]] = frozenset({"name"})
    _source: str = PrivateAttr(default="")

    name: Name
    driver: str
    python: Annotated[str, checked("an absolute path of a Python interpreter", _interpreter)] = ""
    rate_hz: Annotated[float, Field(ge=1.0, le=MAX_RATE_HZ)] = 500.0
    auto_enable: bool = True
    heartbeat_timeout: Positive = 1.0
    feedback_timeout: Positive = 0.1
    stall_timeout: Positive = 0.5
    phase: Annotated[float, Field(ge=0.0, lt=1.0)] = FIRST_PHASE
    spin_us: Annotated[int, Field(ge=0, le=1000)] = SPIN_US
    priority: Annotated[int, Field(ge=0, le=99)] = 80
    compensate_latency: Annotated[
        bool | float,
        checked(
            f"{_SECONDS}, or true or false",
            lambda value: value if isinstance(value, bool) else _seconds(value),
        ),
    ] = False
    latency: Annotated[float, checked(_SECONDS, _seconds)] | None = None
    limits: LimitSettings = LimitSettings()
    frames: dict[str, Any] = Field(default_factory=dict)
    keep_out: list[dict[str, Any]] = Field(default_factory=list)
    options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_together(self) -> DeviceSettings:
        if self.compensate_latency is True and self.latency is None:
            raise RequestError(
                "compensate_latency",
                "true needs latency, in seconds; "
                f"`orientd doctor --config FILE --latency {self.name}` finds it",
            )
        if self.limits.model_fields_set:
            self.limits.to_limits().check_range(1.0 / self.rate_hz)
        try:
            self.to_frames()
        except RequestError as error:
            raise RequestError(f"frames.{error.field}", error.problem) from error
        try:
            self.to_keep_out()
        except RequestError as error:
            raise RequestError(f"keep_out{error.field}", error.problem) from error
        return self

    def model_post_init(self, context: Mapping[str, str] | None) -> None:
        """Keep the name of the file."""
        self._source = (context or {}).get(SOURCE, "")

    def to_frames(self) -> Mapping[str, Frame]:
        """Return the frames as the planner has them.

        Raises:
            RequestError: one is not well formed.
        """
        if not self.frames:
            return {}
        from orientd.model.reading import read_frames
        from orientd.model.request import named_frames

        return named_frames(read_frames(self.frames))

    def to_keep_out(self) -> tuple[KeepOut, ...]:
        """Return the keep-out cones.

        Raises:
            RequestError: one is not well formed, or two have one name.
        """
        return read_cones(self.keep_out) if self.keep_out else ()

    def make_driver(self) -> Driver:
        """Return the driver, which never opens its device.

        Raises:
            ConfigError: the driver is not installed, or refuses its options; the line names the
                file.
        """
        from orientd.driver import make_driver

        try:
            return make_driver(self.name, self.driver, self.options, self.period_ns)
        except ConfigError as error:
            source = f"{self._source}: " if self._source else ""
            raise ConfigError(f"{source}{error}") from error

    def planner(self) -> DevicePlanner:
        """Return what plans for this device, without a daemon.

        Raises:
            ConfigError: the driver is not installed, or refuses its options.
        """
        from orientd.planner.device_planner import DevicePlanner

        return DevicePlanner(
            self.make_driver(),
            limits=self.limits.to_limits(),
            period=self.period_ns * 1e-9,
            frames=self.to_frames(),
            keep_out=self.to_keep_out(),
        )

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
