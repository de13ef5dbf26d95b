"""Prepare the servos of a gimbal, switch their torque on and park them, all without a jerk.

The order of a start matters.  Model and firmware are read before anything is written.  Settings are
written only if they differ, because permanent ones need the torque off.  The goal is set to the
position before the torque comes on.  The watchdog comes last, because from then on silence stops
the servo.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from operator import sub

from orientd.clock import Clock
from orientd.errors import DeviceError, DeviceFaultError
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.servo import DoubtError, Servo, Sleep
from orientd_dynamixel.tables import CURRENT_POSITION, EXTENDED_POSITION
from orientd_dynamixel.turns import Turns

_PARK_LONGEST_S = 20.0
_STEP_S = 0.05
_RESTS = 1
"""Ticks within a step that a resting servo may report."""


def overwritten(servos: Sequence[Servo], may_overwrite: Collection[str]) -> list[list[str]]:
    """Return which of each servo's own settings will be overwritten, in words.

    Args:
        servos: of the gimbal.
        may_overwrite: names of the allowed settings.

    Raises:
        DeviceFaultError: a servo has another setting that may not be overwritten; nothing was
            written.
    """
    own = {servo: servo.foreign() for servo in servos}
    refused = {name for settings in own.values() for name in settings} - set(may_overwrite)
    if refused:
        named = "; ".join(
            f"{servo} has "
            + " and ".join(
                f"{n.replace('_', ' ')} {settings[n][0]}" for n in settings if n in refused
            )
            for servo, settings in own.items()
            if refused & settings.keys()
        )
        raise DeviceFaultError(
            f"{named}; orientd sets offset and drive mode to 0, which changes angles, and the mode "
            f"to {EXTENDED_POSITION}, or {CURRENT_POSITION} with current_limit, which lifts the "
            "servo's position limits: do it with the vendor's wizard, or permit it with "
            f"overwrite = {sorted(refused)}"
        )
    return [
        [
            f"{servo}: {name.replace('_', ' ')} {before} is set to {after}"
            for name, (before, after) in settings.items()
        ]
        for servo, settings in own.items()
    ]


def prepare(
    servos: Sequence[Servo],
    options: GimbalOptions,
    turns: Turns,
    sleep: Sleep,
    clock: Clock,
    *,
    told: list[str],
) -> str:
    """Correct the settings of every servo and find out its turn; nothing moves.

    Args:
        servos: of the gimbal.
        options: of the driver.
        turns: what is known of the servos' turns.
        sleep: waits.
        clock: for the time of a reading.
        told: takes the overwritten settings, in words, also those before an error.

    Returns:
        The servos on an unknown turn, in words; empty if there are none.

    Raises:
        LinkError: a servo does not answer.
        DeviceFaultError: one is another model, may not be corrected, or cannot be.
    """
    for servo in servos:
        servo.identify()
    turns.close()  # the user deletes the file to start over
    turns.open()
    changed = overwritten(servos, options.overwrite)
    unknown = []
    for place, servo in enumerate(servos):
        told += changed[place]
        servo.clear_error(sleep)
        has_counted = servo.has_kept_power() and not turns.is_lost(place)
        if not has_counted:
            turns.lose(place)  # once it is configured it would seem to have kept its power
        servo.position = turns.last(place) if has_counted else None
        try:
            servo.configure()
            position = servo.present_position()
        except DoubtError as error:
            unknown.append(str(error))
            continue
        unknown.append(turns.resolve(place, position, has_kept_power=has_counted))
        servo.believe(position, clock.now_ns())
    return "; ".join(filter(None, unknown))


def engage_all(servos: Sequence[Servo]) -> list[Servo]:
    """Switch the torque of all servos on at their positions, or of none; return which had it off.

    Raises:
        DeviceError: one does not; those that held before keep holding.
    """
    begun: list[Servo] = []
    try:
        # One at a time: when one fails, it must be known which were switched on.
        for servo in servos:
            begun += [servo] if servo.engage() else []
    except DeviceError:
        for servo in begun:
            servo.release()
        raise
    return begun


def park(servos: Sequence[Servo], angles: Sequence[float], sleep: Sleep) -> None:
    """Move to *angles* slowly and wait until all servos rest there; give up after some time."""
    for servo, angle in zip(servos, angles, strict=True):
        servo.go_slowly(angle)
    before: list[int] = []
    for _ in range(round(_PARK_LONGEST_S / _STEP_S)):
        positions = [servo.get(servo.table.position) for servo in servos]
        is_near = all(map(Servo.is_near_goal, servos, positions))
        # A load may keep a servo from its goal, so it counts as parked once it rests nearby.
        if is_near and before and max(map(abs, map(sub, positions, before))) <= _RESTS:
            return
        before = positions
        sleep(_STEP_S)
