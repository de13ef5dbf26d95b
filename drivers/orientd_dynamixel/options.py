"""The driver's options: what the table ``[devices.NAME.options]`` may hold.

.. code-block:: toml

    port = "/dev/ttyUSB0"
    baud = 1000000             # the speed the servos are set to
    order = "ZYX"              # axes from the base to the tool
    fast_read = "auto"         # auto, on or off; the servos' firmware decides
    watchdog_ms = 500          # servos stop by themselves after this silence
    max_losses = 10            # answers lost in a row until it is a fault
    at_end = "release"         # or "hold": leave the torque on
    park_deg = [0, 0, 0]       # go here before the torque is switched off
    max_deviation_deg = 0.0    # by how much a path near the pole may be missed; 0 refuses it
    allow_slews = false        # whether the tool may stop and leave its path to change branch

    [[axes]]                   # one for each letter of order
    id = 1
    name = "yaw"
    model = "xm430"            # or xl330
    gear = 1.0                 # turns of the servo for one of the axis
    direction = 1              # or -1
    zero_deg = 0.0             # angle of the axis where the servo's position is 2048
    limits_deg = [-170, 170]
    velocity_deg = 220         # degrees a second; 80 % of what the servo does without load
    acceleration_deg = 2290    # degrees a second squared

Of all that stops the gimbal the servos' own watchdog is the last: it ends in an error that has to
be reset, and the stop is abrupt.  A lost answer costs two cycles or ``latency_ms``, so ten of them
in a row, 0.2 s at 100 Hz, are a fault that names the servo; it comes before the feedback is too old
for the daemon (0.3 s), and goals are sent all the while.  A servo that nobody talks to stands still
at its last goal anyway, one cycle's step away, so half a second of silence until the watchdog does
no harm, and a machine that is busy for less is ridden out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
"""Those that both the servos and the vendor's SDK know."""

DEFAULT_ACCELERATION = 40.0
"""rad/s^2 of an axis where nothing else is said; an XM430 with a camera on it can do that."""

QUATERNION = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ServoModel:
    """What the driver has to know of a kind of servo.

    Attributes:
        name: as printed on it.
        number: what it answers to a ping.
        fast_firmware: the first version that answers fast reads.
        indirect_data: address of its first indirect byte.
        indirect_address: address of the first entry of the map.
        no_load_speed: rad/s.
        current_unit: A of one step.
    """

    name: str
    number: int
    fast_firmware: int
    indirect_data: int
    indirect_address: int
    no_load_speed: float
    current_unit: float


MODELS: Mapping[str, ServoModel] = {
    "xm430": ServoModel("XM430-W350", 1020, 45, 224, 168, 4.817, 0.00269),
    "xl330": ServoModel("XL330-M288", 1200, 46, 208, 168, 10.79, 0.001),
}


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
    follow_time: float
    max_losses: int
    latency_ms: float
    max_deviation: float
    allow_slews: bool


_AXIS_KEYS = {
    "id", "name", "model", "gear", "direction", "zero_deg", "limits_deg", "velocity_deg",
    "acceleration_deg", "current_limit",
}  # fmt: skip
_KEYS = {
    "port", "baud", "order", "axes", "mount", "tool", "fast_read", "watchdog_ms", "at_end",
    "park_deg", "pointing", "roll_tolerance_deg", "follow_tolerance_deg", "follow_time",
    "max_losses", "latency_ms", "max_deviation_deg", "allow_slews",
}  # fmt: skip


def parse(options: Mapping[str, Any]) -> GimbalOptions:
    """Check *options* and put them into SI.

    Raises:
        ValueError: one is unknown, missing or not allowed; the message names it.
    """
    _known(options, _KEYS, "")
    order = options.get("order", "ZYX")
    if not isinstance(order, str) or not _is_order(order):
        raise ValueError(
            f"order must be two or three of X, Y and Z with none twice in a row, got {order!r}"
        )
    rows = options.get("axes")
    if not isinstance(rows, (list, tuple)) or len(rows) != len(order):
        raise ValueError(f"axes must be {len(order)} tables, one for each of {order}, got {rows!r}")
    axes = tuple(_axis(row, number, order[number]) for number, row in enumerate(rows))
    ids = [axis.id for axis in axes]
    if len(set(ids)) != len(ids):
        raise ValueError(f"axes must have different ids, got {ids}")
    port = options.get("port")
    if not isinstance(port, str) or not port:
        raise ValueError(f"port must be the path of a serial port, got {port!r}")
    park = options.get("park_deg")
    if park is not None:
        if not isinstance(park, (list, tuple)) or len(park) != len(axes):
            raise ValueError(f"park_deg must be {len(axes)} angles, got {park!r}")
        park = tuple(math.radians(_number("park_deg", angle)) for angle in park)
        for axis, angle in zip(axes, park, strict=True):
            if not axis.low <= angle <= axis.high:
                raise ValueError(f"park_deg must be inside the limits of {axis.name}, got {park!r}")
    return GimbalOptions(
        port=port,
        baud=_choice("baud", options.get("baud", 1_000_000), BAUD_RATES),
        order=order,
        axes=axes,
        mount=_quaternion("mount", options.get("mount")),
        tool=_quaternion("tool", options.get("tool")),
        fast_read=_choice("fast_read", options.get("fast_read", "auto"), ("auto", "on", "off")),
        watchdog_ms=round(_number("watchdog_ms", options.get("watchdog_ms", 500), 0, 2540)),
        at_end=_choice("at_end", options.get("at_end", "release"), ("release", "hold")),
        park=park,
        pointing=_choice("pointing", options.get("pointing", False), (False, True)),
        roll_tolerance=math.radians(
            _number("roll_tolerance_deg", options.get("roll_tolerance_deg", 1.0), 0, 180)
        ),
        follow_tolerance=math.radians(
            _number("follow_tolerance_deg", options.get("follow_tolerance_deg", 15.0), 0.1, 360)
        ),
        follow_time=_number("follow_time", options.get("follow_time", 0.3), 0.01, 10),
        max_losses=round(_number("max_losses", options.get("max_losses", 10), 1, 1000)),
        latency_ms=_number("latency_ms", options.get("latency_ms", 16.0), 0.1, 1000),
        max_deviation=math.radians(
            _number("max_deviation_deg", options.get("max_deviation_deg", 0.0), 0, 45)
        ),
        allow_slews=_choice("allow_slews", options.get("allow_slews", False), (False, True)),
    )


def _is_order(order: str) -> bool:
    return (
        len(order) in {2, 3}
        and all(letter in "XYZ" for letter in order)
        and all(order[k] != order[k + 1] for k in range(len(order) - 1))
    )


def _axis(row: object, number: int, letter: str) -> AxisOptions:
    where = f"axes[{number}]."
    if not isinstance(row, Mapping):
        raise ValueError(f"axes[{number}] must be a table, got {row!r}")
    _known(row, _AXIS_KEYS, where)
    identity = row.get("id")
    if isinstance(identity, bool) or not isinstance(identity, int) or not 0 <= identity <= 252:
        raise ValueError(f"{where}id must be a whole number from 0 to 252, got {identity!r}")
    model = MODELS[_choice(f"{where}model", row.get("model", "xm430"), tuple(MODELS))]
    gear = _number(f"{where}gear", row.get("gear", 1.0), 1e-3, 1e3)
    fastest = model.no_load_speed / gear
    velocity = math.radians(
        _number(f"{where}velocity_deg", row.get("velocity_deg", math.degrees(0.8 * fastest)))
    )
    if not 0.0 < velocity <= fastest:
        raise ValueError(
            f"{where}velocity_deg must be above 0 and at most {math.degrees(fastest):.1f}, "
            f"what {model.name} does without load, got {math.degrees(velocity):.1f}"
        )
    limits = row.get("limits_deg", [-180, 180])
    if not isinstance(limits, (list, tuple)) or len(limits) != 2:
        raise ValueError(f"{where}limits_deg must be two angles, got {limits!r}")
    low, high = (math.radians(_number(f"{where}limits_deg", angle)) for angle in limits)
    if not low < high:
        raise ValueError(f"{where}limits_deg must be the lower angle first, got {limits!r}")
    zero = math.radians(_number(f"{where}zero_deg", row.get("zero_deg", 0.0)))
    farthest = max(abs(low - zero), abs(high - zero)) * gear / (2 * math.pi) * 4096
    if farthest + 2048 > 1_048_575:
        raise ValueError(f"{where}limits_deg must be within 255 turns of the servo, got {limits!r}")
    current = row.get("current_limit")
    name = row.get("name", letter.lower())
    if not isinstance(name, str) or not name:
        raise ValueError(f"{where}name must be a text, got {name!r}")
    return AxisOptions(
        id=identity,
        name=name,
        model=model,
        gear=gear,
        direction=_choice(f"{where}direction", row.get("direction", 1), (1, -1)),
        zero=zero,
        low=low,
        high=high,
        velocity=velocity,
        acceleration=math.radians(
            _number(
                f"{where}acceleration_deg",
                row.get("acceleration_deg", math.degrees(DEFAULT_ACCELERATION)),
                1.0,
                1e5,
            )
        ),
        current_limit=None if current is None else _number(f"{where}current_limit", current, 0, 4),
    )


def _known(table: Mapping[str, Any], keys: set[str], where: str) -> None:
    for key in table:
        if key not in keys:
            raise ValueError(
                f"unknown option {where + key!r}, allowed are: {', '.join(sorted(keys))}"
            )


def _number(option: str, given: object, least: float = -math.inf, most: float = math.inf) -> float:
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not math.isfinite(given):
        raise ValueError(f"{option} must be a number, got {given!r}")
    if not least <= given <= most:
        raise ValueError(f"{option} must be from {least:g} to {most:g}, got {given!r}")
    return float(given)


def _choice(option: str, given: Any, allowed: tuple[Any, ...]) -> Any:  # noqa: ANN401 - checked
    if not any(given == item and type(given) is type(item) for item in allowed):
        raise ValueError(f"{option} must be one of {', '.join(map(str, allowed))}, got {given!r}")
    return given


def _quaternion(option: str, given: object) -> tuple[float, float, float, float]:
    if given is None:
        return QUATERNION
    if not isinstance(given, Mapping) or set(given) != set("wxyz"):
        raise ValueError(f"{option} must be {{w, x, y, z}}, got {given!r}")
    w, x, y, z = (_number(option, given[key]) for key in "wxyz")
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if abs(length - 1.0) > 1e-6:
        raise ValueError(f"{option} must have norm 1, got {length:.9g}")
    return (w / length, x / length, y / length, z / length)
