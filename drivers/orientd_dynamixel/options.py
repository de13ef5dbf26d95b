"""The driver's options: what the table ``[devices.NAME.options]`` may hold.

.. code-block:: toml

    port = "/dev/ttyUSB0"
    baud = 1000000             # the speed the servos are set to
    order = "ZYX"              # axes from the base to the tool
    fast_read = "auto"         # auto, on or off; the servos' firmware decides
    watchdog_ms = 500          # servos stop by themselves after this silence
    max_losses = 10            # lost answers in a row until a fault
    at_end = "release"         # or "hold": leave the torque on
    park_deg = [0, 0, 0]       # move here before the torque goes off
    pointing = true            # two axes: only the direction counts; false: the roll counts too
    max_deviation_deg = 0.0    # allowed deviation from a path near the pole; 0 refuses the path
    arrival_tolerance_deg = 2.0  # a motion is done when every axis is this close to its end
    follow_tolerance_deg = 15.0  # it is a fault if an axis is farther from its goal than this ...
    follow_time = 0.3          # ... for longer than this, s
    turns_file = ""            # file for whole turns; default in the XDG state directory
    overwrite = false          # settings of the servos that may be overwritten: true, or a list
                               # of "homing_offset", "drive_mode" and "operating_mode"
    allow_slews = false        # whether the tool may leave its path while the axes change branch
    on_target_deg = 0.5        # error from which the certificate counts the target as lost

    [[axes]]                   # one for each letter of order
    id = 1
    name = "yaw"
    model = "xm430"            # or xl330, xm540-w270, ...: see MODELS
    gear = 1.0                 # turns of the servo per turn of the axis
    direction = 1              # or -1
    zero_deg = 0.0             # angle of the axis at servo position 2048
    limits_deg = [-170, 170]   # or "endless": as far as the servo counts, 255 turns or more
    velocity_deg = 220         # degrees/s; default 80 % of the servo's speed without load
    acceleration_deg = 2290    # degrees/s^2
    current_limit = 0.8        # A, if the servo measures it; it yields at more (mode 5)

The servos' own watchdog is the last of all stops of the gimbal: it is abrupt and ends in an error
that needs a reset.  A lost answer costs two cycles or ``latency_ms``.  Ten of them in a row, 0.2 s
at 100 Hz, are a fault that names the servo.  It comes before the daemon's feedback timeout (0.3 s),
and goals are sent meanwhile.  A servo without messages stands still at its last goal anyway, one
cycle's step away.  So half a second of silence until the watchdog is harmless, and bridges a busy
machine.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from orientd.driver import (
    AxisLimits,
    check_names,
    choice,
    number,
    numbers,
    quaternion,
    switch,
    whole,
)
from orientd.mechanism.gimbal import Gimbal
from orientd_dynamixel.tables import BAUD_RATES, MODELS, ServoModel

DEFAULT_ACCELERATION = 40.0
"""Default acceleration of an axis, rad/s^2; an XM430 with a camera can do that."""


OWN_SETTINGS = frozenset({"homing_offset", "drive_mode", "operating_mode"})
"""Settings of a servo that other software may use: orientd reports or refuses to change them."""


@dataclass(frozen=True, slots=True)
class AxisOptions:
    """One axis.  Angles in rad, at the axis and not at the servo."""

    id: int
    name: str
    model: ServoModel
    gear: float
    direction: int
    zero: float
    low: float
    high: float
    velocity: float
    acceleration: float
    current_limit: float | None

    @property
    def resolution(self) -> float:
        """The angle of one tick, rad."""
        return 2.0 * math.pi / (self.model.ticks * self.gear)


@dataclass(frozen=True, slots=True)
class GimbalOptions:
    """The whole table, checked."""

    port: str
    baud: int
    order: str
    axes: tuple[AxisOptions, ...]
    mount: tuple[float, float, float, float]
    tool: tuple[float, float, float, float]
    fast_read: str
    watchdog_ms: int
    at_end: str
    park: tuple[float, ...] | None
    pointing: bool
    roll_tolerance: float
    follow_tolerance: float
    arrival_tolerance: float
    follow_time: float
    max_losses: int
    latency_ms: float
    max_deviation: float
    allow_slews: bool
    on_target: float
    turns_file: str | None
    overwrite: frozenset[str]

    def gimbal(self) -> Gimbal:
        """Return the gimbal that the servos form."""
        limits = [
            AxisLimits(
                axis.name,
                axis.low,
                axis.high,
                axis.velocity,
                axis.acceleration,
                resolution=axis.resolution,
            )
            for axis in self.axes
        ]
        return Gimbal(
            limits,
            order=self.order,
            mount=self.mount,
            tool=self.tool,
            is_pointing=self.pointing,
            roll_tolerance=self.roll_tolerance,
            max_deviation=self.max_deviation,
            allow_slews=self.allow_slews,
            on_target=self.on_target,
        )


_ORDER = re.compile(r"(?:([XYZ])(?!\1)){2,3}")
_AXIS_KEYS = {
    "id", "name", "model", "gear", "direction", "zero_deg", "limits_deg", "velocity_deg",
    "acceleration_deg", "current_limit",
}  # fmt: skip
# Name: lowest, highest, default.
_NUMBERS: dict[str, tuple[float, float, float]] = {
    "watchdog_ms": (0, 2540, 500),
    "roll_tolerance_deg": (0, 180, 1.0),
    "follow_tolerance_deg": (0.1, 360, 15.0),
    "follow_time": (0.01, 10, 0.3),
    "arrival_tolerance_deg": (0.1, 360, 2.0),
    "max_losses": (1, 1000, 10),
    "latency_ms": (0.1, 1000, 16.0),
    "max_deviation_deg": (0, 45, 0.0),
    "on_target_deg": (0.001, 45, 0.5),
}
_KEYS = {
    "port", "baud", "order", "axes", "mount", "tool", "fast_read", "at_end", "park_deg", "pointing",
    "allow_slews", "turns_file", "overwrite", *_NUMBERS,
}  # fmt: skip


def parse(options: Mapping[str, Any]) -> GimbalOptions:
    """Check *options* and convert them to SI.

    Raises:
        ValueError: one is unknown, missing or has a wrong value; the message names it.
    """
    check_names(options, _KEYS)
    order = options.get("order", "ZYX")
    if not isinstance(order, str) or not _ORDER.fullmatch(order):
        raise ValueError(
            f"order must be two or three of X, Y and Z with none twice in a row, got {order!r}"
        )
    rows = options.get("axes")
    if not isinstance(rows, (list, tuple)) or len(rows) != len(order):
        raise ValueError(f"axes must be {len(order)} tables, one for each of {order}, got {rows!r}")
    letters = [
        letter.lower() + "2" * (letter in order[:place]) for place, letter in enumerate(order)
    ]
    axes = tuple(_axis(*one) for one in zip(rows, range(len(rows)), letters, strict=True))
    for what, found in (("ids", [a.id for a in axes]), ("names", [a.name for a in axes])):
        if len(set(found)) != len(found):
            raise ValueError(f"axes must have different {what}, got {found}")
    port, turns_file, parked = (options.get(one) for one in ("port", "turns_file", "park_deg"))
    if not isinstance(port, str) or not port:
        raise ValueError(f"port must be the path of a serial port, got {port!r}")
    if turns_file is not None and not isinstance(turns_file, str):
        raise ValueError(f"turns_file must be a path, or empty for none, got {turns_file!r}")
    park = None
    if parked is not None:
        park = tuple(map(math.radians, numbers("park_deg", parked, len(axes))))
        for axis, angle in zip(axes, park, strict=True):
            if not axis.low <= angle <= axis.high:
                raise ValueError(f"park_deg must be within the limits of {axis.name}, got {parked}")
    numbered = {
        name: number(name, options.get(name, default), lowest, highest)
        for name, (lowest, highest, default) in _NUMBERS.items()
    }
    in_rad = {
        name.removesuffix("_deg"): math.radians(numbered.pop(name))
        for name in tuple(numbered)
        if name.endswith("_deg")
    }
    return GimbalOptions(
        port=port,
        baud=choice("baud", options.get("baud", 1_000_000), BAUD_RATES),
        order=order,
        axes=axes,
        mount=quaternion("mount", options.get("mount")),
        tool=quaternion("tool", options.get("tool")),
        fast_read=choice("fast_read", options.get("fast_read", "auto"), ("auto", "on", "off")),
        at_end=choice("at_end", options.get("at_end", "release"), ("release", "hold")),
        park=park,
        pointing=switch("pointing", options.get("pointing", len(axes) == 2)),
        allow_slews=switch("allow_slews", options.get("allow_slews", False)),
        turns_file=turns_file,
        overwrite=_overwrite(options.get("overwrite", False)),
        watchdog_ms=round(numbered.pop("watchdog_ms")),
        max_losses=round(numbered.pop("max_losses")),
        **numbered,
        **in_rad,
    )


def _overwrite(given: object) -> frozenset[str]:
    """Return the settings that *given* allows to overwrite."""
    if isinstance(given, bool):
        return OWN_SETTINGS if given else frozenset()
    if isinstance(given, (list, tuple)) and all(map([*OWN_SETTINGS].__contains__, given)):
        return frozenset(given)
    names = ", ".join(sorted(OWN_SETTINGS))
    raise ValueError(f"overwrite must be true, false or a list of {names}, got {given!r}")


def _axis(row: object, place: int, called: str) -> AxisOptions:
    where = f"axes[{place}]."
    if not isinstance(row, Mapping):
        raise ValueError(f"axes[{place}] must be a table, got {row!r}")
    check_names(row, _AXIS_KEYS, where)

    def value(name: str, default: float, *span: float) -> float:
        return number(f"{where}{name}", row.get(name, default), *span)

    model = MODELS[choice(f"{where}model", row.get("model", "xm430"), tuple(MODELS))]
    gear = value("gear", 1.0, 1e-3, 1e3)
    fastest = model.no_load_speed / gear
    velocity = math.radians(value("velocity_deg", math.degrees(0.8 * fastest)))
    if not 0.0 < velocity <= fastest:
        raise ValueError(
            f"{where}velocity_deg must be above 0 and at most {math.degrees(fastest):.1f}, "
            f"what {model.name} does without load, got {math.degrees(velocity):.1f}"
        )
    limits = row.get("limits_deg", [-180, 180])
    zero = math.radians(value("zero_deg", 0.0))
    reach = 2 * math.pi * model.most_turns / gear
    low, high = zero - reach, zero + reach
    if limits != "endless":
        low, high = map(math.radians, numbers(f"{where}limits_deg", limits, 2))
    if not low < high:
        raise ValueError(f"{where}limits_deg must be the lower angle first, got {limits!r}")
    if max(zero - low, high - zero) > reach * (1.0 + 1e-9):
        raise ValueError(
            f"{where}limits_deg must be within {model.most_turns} turns of the servo, got "
            f"{limits!r}"
        )
    current = row.get("current_limit")
    if current is not None:
        if not (model.current_unit and model.family.limits_current):
            raise ValueError(f"{where}current_limit: a {model.name} has no limit of its current")
        current = value("current_limit", current, model.current_unit, 4)
    name = row.get("name", called)
    if not isinstance(name, str) or not name:
        raise ValueError(f"{where}name must be a text, got {name!r}")
    return AxisOptions(
        id=whole(f"{where}id", row.get("id"), 0, 252),
        name=name,
        model=model,
        gear=gear,
        direction=choice(f"{where}direction", row.get("direction", 1), (1, -1)),
        zero=zero,
        low=low,
        high=high,
        velocity=velocity,
        acceleration=math.radians(
            value("acceleration_deg", math.degrees(DEFAULT_ACCELERATION), 1.0, 1e5)
        ),
        current_limit=current,
    )
