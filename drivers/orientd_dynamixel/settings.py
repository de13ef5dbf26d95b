"""The settings of a servo: which are its own, and how they have to be.

Permanent ones are written only where they differ, because they need the torque off.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from orientd.errors import DeviceFaultError
from orientd_dynamixel.axis import Axis, sendable
from orientd_dynamixel.bus import (
    BLOCK,
    HEALTH,
    RETURN_LEVEL,
    VELOCITY_UNIT,
    WATCHDOG_TRIPPED,
    ServoBus,
)
from orientd_dynamixel.options import AxisOptions
from orientd_dynamixel.whereabouts import GOAL, TORQUE, present_position

RETURN_DELAY, DRIVE_MODE, OPERATING_MODE, HOMING_OFFSET, CURRENT_LIMIT = 9, 10, 11, 20, 38
VELOCITY_LIMIT = 44
LEVEL, WATCHDOG, GOAL_CURRENT = 68, 98, 102
PROFILE_ACCELERATION, PROFILE_VELOCITY = 108, 112
EXTENDED_POSITION, CURRENT_POSITION = 4, 5
PARK_RATE = 22
"""Profile velocity of parking, 30 degrees a second."""

_PROFILE_MARGIN = 1.2
"""Room for a servo to catch up with its goals."""


def has_kept_power(bus: ServoBus, axis: AxisOptions) -> bool:
    """Return whether a servo has had power since it was configured, and counts turns since then."""
    mapped = b"".join(address.to_bytes(2, "little") for address in BLOCK + HEALTH)
    found = bus.read(axis.id, axis.model.indirect_address, len(mapped))
    is_counting = bus.read(axis.id, OPERATING_MODE, 1) == _mode(axis)
    return is_counting and found == int.from_bytes(mapped, "little")


def _mode(axis: AxisOptions) -> int:
    """Return the operating mode in which a servo counts turns, and its current is limited."""
    return EXTENDED_POSITION if axis.current_limit is None else CURRENT_POSITION


def own_settings(bus: ServoBus, servo: int) -> dict[str, int]:
    """Return what the settings of a servo are set to that mean something beside orientd."""
    return {
        "homing_offset": bus.read(servo, HOMING_OFFSET, 4, is_signed=True),
        "drive_mode": bus.read(servo, DRIVE_MODE, 1),
        "operating_mode": bus.read(servo, OPERATING_MODE, 1),
    }


def foreign(axis: AxisOptions, settings: Mapping[str, int]) -> dict[str, tuple[int, int]]:
    """Return what *settings* are that are not as they must be, and what they must be, by name.

    Args:
        axis: of the servo.
        settings: as from :func:`own_settings`.
    """
    wanted = {"homing_offset": 0, "drive_mode": 0, "operating_mode": _mode(axis)}
    pairs = {name: (value, wanted[name]) for name, value in settings.items()}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def overwritten(
    bus: ServoBus, axes: Sequence[AxisOptions], may_overwrite: Collection[str]
) -> list[str]:
    """Return what is about to be overwritten in the servos' own settings, a line a servo.

    Args:
        bus: theirs.
        axes: of the gimbal.
        may_overwrite: names of the settings that may be.

    Raises:
        DeviceFaultError: a servo has a setting of its own that may not be; nothing was written.
    """
    own = {axis: foreign(axis, own_settings(bus, axis.id)) for axis in axes}
    refused = {name for settings in own.values() for name in settings} - set(may_overwrite)
    if refused:
        named = "; ".join(
            f"servo {axis.id} ({axis.name}) has "
            + " and ".join(f"{_words(n)} {settings[n][0]}" for n in settings if n in refused)
            for axis, settings in own.items()
            if refused & settings.keys()
        )
        raise DeviceFaultError(
            f"{named}; orientd sets offset and drive mode to 0, which changes angles, and the mode "
            f"to {EXTENDED_POSITION}, or {CURRENT_POSITION} with current_limit, which lifts the "
            "servo's position limits: do it with the vendor's wizard, or permit it with "
            f"overwrite = {sorted(refused)}"
        )
    return [
        f"servo {axis.id} ({axis.name}): {_words(name)} {before} is set to {after}"
        for axis, settings in own.items()
        for name, (before, after) in settings.items()
    ]


def _words(name: str) -> str:
    return name.replace("_", " ")


def configure(bus: ServoBus, whole: Axis) -> None:
    """Put the settings of an axis' servo right, the permanent ones only where they differ.

    Raises:
        DoubtError: it has stopped by itself, and reports a position at which it cannot be.
        DeviceFaultError: it does not take a setting.
    """
    axis = whole.options
    if bus.read(axis.id, LEVEL, 1) != RETURN_LEVEL:
        bus.write(axis.id, LEVEL, RETURN_LEVEL, 1)
    quiet_watchdog(bus, whole)
    permanent = [(RETURN_DELAY, 1, 0), (DRIVE_MODE, 1, 0), (OPERATING_MODE, 1, _mode(axis)),
                 (HOMING_OFFSET, 4, 0)]  # fmt: skip
    wrong = [row for row in permanent if bus.read(axis.id, row[0], row[1]) != row[2]]
    if wrong:
        bus.write(axis.id, TORQUE, 0, 1)
        for row in wrong:
            _put(bus, axis, *row)
    for number, address in enumerate(BLOCK + HEALTH):
        bus.write(axis.id, axis.model.indirect_address + 2 * number, address, 2)
    bus.write(axis.id, PROFILE_ACCELERATION, 0, 4)
    # No more than what is asked of it, whatever lets go of it: a servo knows no other limit.
    fastest = math.ceil(_PROFILE_MARGIN * axis.velocity * axis.gear / VELOCITY_UNIT)
    bus.write(axis.id, PROFILE_VELOCITY, min(fastest, bus.read(axis.id, VELOCITY_LIMIT, 4)), 4)
    if axis.current_limit is not None:
        steps = round(axis.current_limit / axis.model.current_unit)
        if steps > (ceiling := bus.read(axis.id, CURRENT_LIMIT, 2)):
            raise DeviceFaultError(
                f"servo {axis.id} ({axis.name}) gives {ceiling * axis.model.current_unit:.2f} A at "
                f"the most, current_limit is {axis.current_limit:g} A"
            )
        _put(bus, axis, GOAL_CURRENT, 2, steps)


def _put(bus: ServoBus, axis: AxisOptions, address: int, count: int, value: int) -> None:
    """Write a setting of a servo and look whether it has taken it.

    Raises:
        DeviceFaultError: it has not.
    """
    bus.write(axis.id, address, value, count)
    if (kept := bus.read(axis.id, address, count)) != value:
        raise DeviceFaultError(
            f"servo {axis.id} ({axis.name}) keeps {kept} at address {address}, asked was {value}"
        )


def quiet_watchdog(bus: ServoBus, axis: Axis) -> int | None:
    """Switch the watchdog off; return the new goal if it had tripped.

    A tripped servo has stopped, but may keep its old goal and go there once it is allowed to: its
    goal becomes where it is.

    Raises:
        DoubtError: it has tripped, and reports a position at which it cannot be; it stays stopped.
    """
    servo = axis.options.id
    state = bus.read(servo, WATCHDOG, 1)
    if state != WATCHDOG_TRIPPED:
        if state:
            bus.write(servo, WATCHDOG, 0, 1)
        return None
    # Read first, so that nothing but the goal itself comes between the two writes.
    goal = sendable(present_position(bus, axis))
    bus.write(servo, WATCHDOG, 0, 1)
    bus.write(servo, GOAL, goal, 4)
    return goal
