"""Make servos ready: find them, put their settings right, start and stop them without a jerk.

The order matters.  A servo is asked for model and firmware before anything is written; settings
are written only where they differ, because the permanent ones need the torque off; the goal is
where the servo is before the torque comes on; the watchdog is last, because from then on silence
stops it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from orientd.errors import DeviceError, DeviceFaultError, LinkError
from orientd_dynamixel.axes import Turns
from orientd_dynamixel.axis import Axis, sendable
from orientd_dynamixel.bus import (
    ATTEMPTS,
    PATIENT_ATTEMPTS,
    ServoBus,
    explain_error,
)
from orientd_dynamixel.options import AxisOptions, GimbalOptions
from orientd_dynamixel.settings import (
    PARK_RATE,
    PROFILE_ACCELERATION,
    PROFILE_VELOCITY,
    WATCHDOG,
    configure,
    has_kept_power,
    overwritten,
    quiet_watchdog,
)
from orientd_dynamixel.whereabouts import (
    GOAL,
    POSITION,
    TORQUE,
    DoubtError,
    present_position,
)

HARDWARE_ERROR = 70
WATCHDOG_UNIT_MS = 20
BOOT_ATTEMPTS = 20
BOOT_STEP_S = 0.05
HELD_TICKS = 40
"""A goal this close to the position is kept: the torque was on, and the load hangs on it."""

Sleep = Callable[[float], None]


class Prepared(NamedTuple):
    """What was found and done when servos were prepared.

    Attributes:
        firmware: of each servo, by its id.
        overwritten: which settings of their own were, in words.
        unknown: which are on an unknown turn, in words; empty where none is.
    """

    firmware: dict[int, int]
    overwritten: list[str]
    unknown: str


def identify(bus: ServoBus, axis: AxisOptions) -> int:
    """Return the firmware of an axis' servo.

    Raises:
        LinkError: it does not answer.
        DeviceFaultError: it is another model.
    """
    found = next(filter(None, (bus.ping(axis.id) for _ in range(ATTEMPTS))), None)
    if found is None:
        raise LinkError(
            f"servo {axis.id} ({axis.name}) does not answer; look at its cable, its supply, its id "
            "and its line speed"
        )
    model, firmware = found
    if model != axis.model.number:
        raise DeviceFaultError(
            f"servo {axis.id} ({axis.name}) is model {model}, configured is {axis.model.name} "
            f"({axis.model.number})"
        )
    return firmware


def clear_error(bus: ServoBus, axis: AxisOptions, sleep: Sleep) -> bool:
    """Start a servo again if it reports a hardware error; return whether it had to be.

    Raises:
        LinkError: it does not come back.
        DeviceFaultError: the error is still there.
    """
    if not bus.read(axis.id, HARDWARE_ERROR, 1):
        return False
    bus.reboot(axis.id)
    for _ in range(BOOT_ATTEMPTS):
        sleep(BOOT_STEP_S)
        if bus.ping(axis.id) is not None:
            break
    else:
        raise LinkError(f"servo {axis.id} ({axis.name}) did not come back after a reboot")
    if bits := bus.read(axis.id, HARDWARE_ERROR, 1):
        raise DeviceFaultError(
            f"servo {axis.id} ({axis.name}) still reports {explain_error(bits)} after a reboot"
        )
    return True


def prepare(
    bus: ServoBus,
    options: GimbalOptions,
    axes: Sequence[Axis],
    turns: Turns,
    sleep: Sleep,
    now_ns: Callable[[], int],
) -> Prepared:
    """Put every servo right and find out on which turn it is; nothing moves.

    Raises:
        LinkError: a servo is not there.
        DeviceFaultError: one is another model, may not be put right, or cannot be.
    """
    firmware = {axis.options.id: identify(bus, axis.options) for axis in axes}
    turns.close()  # whoever deletes the file begins anew
    turns.open()
    changed = overwritten(bus, [axis.options for axis in axes], options.overwrite)
    unknown = []
    for place, axis in enumerate(axes):
        clear_error(bus, axis.options, sleep)
        has_counted = has_kept_power(bus, axis.options)
        axis.position = turns.last(place) if has_counted else None
        try:
            configure(bus, axis)
            position = present_position(bus, axis)
        except DoubtError as error:
            unknown.append(str(error))
            continue
        unknown.append(turns.resolve(place, position, has_kept_power=has_counted))
        axis.believe(position, now_ns())
    return Prepared(firmware, changed, "; ".join(filter(None, unknown)))


def sound_position(bus: ServoBus, axis: Axis) -> int:
    """Return where a servo is, in ticks.

    Raises:
        DeviceFaultError: it reports a hardware error, or a position at which it cannot be.
    """
    servo = axis.options.id
    if bits := _asked(bus, servo, HARDWARE_ERROR, 1):
        raise DeviceFaultError(
            f"servo {servo} ({axis.options.name}) reports {explain_error(bits)}; reset it"
        )
    return present_position(bus, axis)


def _asked(bus: ServoBus, servo: int, address: int, count: int) -> int:
    """Return a register, a position where it has four bytes; patiently.

    Raises:
        LinkError: the servo does not answer.
    """
    return bus.read(servo, address, count, is_signed=count == 4, attempts=PATIENT_ATTEMPTS)


def engage(bus: ServoBus, axis: Axis) -> bool:
    """Switch the torque on with the goal where the servo is; return whether it had been off.

    A servo that holds already goes on with its goal.
    """
    servo, name = axis.options.id, axis.options.name
    position = present_position(bus, axis)
    goal = _asked(bus, servo, GOAL, 4)
    was_on = bool(_asked(bus, servo, TORQUE, 1))
    if not (was_on and abs(goal - position) <= HELD_TICKS):
        goal = sendable(position)
        bus.write(servo, GOAL, goal, 4)
        bus.write(servo, TORQUE, 1, 1)
        if not _asked(bus, servo, TORQUE, 1):
            bits = _asked(bus, servo, HARDWARE_ERROR, 1)
            why = f"it reports {explain_error(bits)}; reset it" if bits else "it says no more"
            raise DeviceFaultError(f"servo {servo} ({name}) does not switch its torque on: {why}")
        goal = _asked(bus, servo, GOAL, 4)
        if abs(goal - position) > HELD_TICKS:
            if not was_on:
                drop(bus, [axis])
            raise DeviceFaultError(
                f"servo {servo} ({name}) has its goal {goal - position} ticks away from where it is"
            )
    axis.goal = goal
    axis.believe(position, axis.seen_ns)
    return not was_on


def engage_all(bus: ServoBus, axes: Sequence[Axis]) -> list[Axis]:
    """Switch the torque of all on where they stand, or of none; return which had it off.

    Raises:
        DeviceError: one does not; those that held before go on holding.
    """
    begun: list[Axis] = []
    try:
        # One at a time: what was begun has to be known when the next one fails.
        for axis in axes:
            begun += [axis] if engage(bus, axis) else []
    except DeviceError:
        drop(bus, begun)
        raise
    return begun


def let_go(bus: ServoBus, axes: Sequence[Axis]) -> None:
    """Switch the torque of all off, so that they can be turned by hand, watchdogs off.

    Raises:
        DeviceError: one could not be reached.
    """
    for axis in axes:
        servo = axis.options.id
        bus.write(servo, WATCHDOG, 0, 1)
        bus.write(servo, TORQUE, 0, 1)


def arm_watchdogs(bus: ServoBus, axes: Sequence[Axis], milliseconds: int) -> None:
    """Let every servo stop by itself after a silence; 0 switches that off."""
    units = -(-milliseconds // WATCHDOG_UNIT_MS)
    for axis in axes:
        bus.write(axis.options.id, WATCHDOG, units, 1)


def hold(bus: ServoBus, axes: Sequence[Axis], standing: Sequence[Axis] = ()) -> None:
    """Leave the servos where they are told to be, watchdogs off.

    Args:
        bus: theirs.
        axes: all of them.
        standing: those that are left where they are, wherever they were told to be.

    Raises:
        DeviceError: one could not be reached; the others hold all the same.
    """
    failure: DeviceError | None = None
    for axis in axes:
        servo = axis.options.id
        try:
            goal = quiet_watchdog(bus, axis)
            if goal is None and axis in standing:
                goal = _standing_goal(bus, axis)
            axis.goal = axis.goal if goal is None else goal
            if axis in standing:
                bus.write(servo, PROFILE_VELOCITY, PARK_RATE, 4)
        except DeviceError as error:
            failure = failure or error
    if failure is not None:
        raise failure


def _standing_goal(bus: ServoBus, axis: Axis) -> int | None:
    """Write where a servo stands as its goal, and return that; not where it cannot be there."""
    try:
        goal = sendable(present_position(bus, axis))
    except DoubtError:
        return None
    bus.write(axis.options.id, GOAL, goal, 4)
    return goal


def drop(bus: ServoBus, axes: Sequence[Axis]) -> None:
    """Switch the torque of *axes* off where they can still be reached."""
    for axis in axes:
        try:
            bus.write(axis.options.id, TORQUE, 0, 1)
        except DeviceError:
            continue


PARK_ACCELERATION = 3
PARK_LONGEST_S = 20.0


def park(bus: ServoBus, axes: Sequence[Axis], angles: Sequence[float], sleep: Sleep) -> bool:
    """Go to *angles* slowly; return whether all arrived in time."""
    goals = [axis.ticks(angle) for axis, angle in zip(axes, angles, strict=True)]
    for axis, goal in zip(axes, goals, strict=True):
        bus.write(axis.options.id, PROFILE_ACCELERATION, PARK_ACCELERATION, 4)
        bus.write(axis.options.id, PROFILE_VELOCITY, PARK_RATE, 4)
        bus.write(axis.options.id, GOAL, goal, 4)
        axis.goal = goal
    for _ in range(round(PARK_LONGEST_S / BOOT_STEP_S)):
        if all(
            abs(bus.read(axis.options.id, POSITION, 4, is_signed=True) - goal) <= HELD_TICKS
            for axis, goal in zip(axes, goals, strict=True)
        ):
            return True
        sleep(BOOT_STEP_S)
    return False


def release(bus: ServoBus, options: GimbalOptions, axes: Sequence[Axis], sleep: Sleep) -> None:
    """Park where that is asked for, then switch the torque off, one servo's failure aside."""
    if options.park is not None and all(bus.read(axis.options.id, TORQUE, 1) for axis in axes):
        park(bus, axes, options.park, sleep)
    drop(bus, axes)
