"""One servo and its axis: units, plausibility of readings, start and stop.

A servo now and then reports a wrong position.  So a reading is accepted only if the servo can be
there. With its torque on, it is between its last known position and the goals since.  With its
torque off, it has turned no faster than by hand.  Outside the cycle it must also report the
position twice.  A rejected reading changes nothing, and no goal ever comes from one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from orientd.errors import DeviceError, DeviceFaultError, LinkError
from orientd_dynamixel.bus import ATTEMPTS, PATIENT_ATTEMPTS, Row, ServoBus, sendable
from orientd_dynamixel.options import AxisOptions
from orientd_dynamixel.tables import (
    CURRENT_POSITION,
    EXTENDED_POSITION,
    RETURN_LEVEL,
    VOLT,
    WATCHDOG_TRIPPED,
    Register,
    explain_error,
)

PARK_RATE = math.radians(30)
"""Velocity of parking, rad/s."""
_ANGLE_SLACK = math.radians(0.5)

_PARK_ACCELERATION = math.radians(64)
_BOOT_STEPS = 20
_BOOT_STEP_S = 0.05
_WATCHDOG_UNIT_MS = 20
_PROFILE_MARGIN = 1.2
"""Lag of a servo behind its goals that is still plausible."""
_PLAY = math.radians(2.1)
"""Backlash, overshoot and rounding."""
_HELD = math.radians(3.5)
"""A goal this close to the position is kept: the torque was on, and the load hangs on it."""
_MARGIN = 1.5
_AGE_S = 0.008
"""Largest age of a reading at its arrival."""

Sleep = Callable[[float], None]


class DoubtError(DeviceFaultError):
    """A servo reports an impossible position."""


class Ratings(NamedTuple):
    """The limits of a servo by its own settings.

    Attributes:
        temperature: degrees Celsius.
        lowest: voltage, V.
        highest: voltage, V.
        current: A; 0 if it does not measure it.
    """

    temperature: int
    lowest: float
    highest: float
    current: float


class Servo:
    """A servo on a bus.

    Attributes:
        bus: its bus, set when the port is opened.
        options: configuration of the servo and its axis.
        turns: whole turns missing in its reading; a servo loses them when it restarts.
        position: its accepted position, in its ticks; ``None`` before it is known.
        seen_ns: time of that position.
        strained: number of readings in a row with a large current.
        firmware: its version, read when the port is opened.
        bears: its limits, read when the port is opened.
        per_turn: ticks of one turn.
        near: how far it may have moved unobserved, ticks: 45 degrees.
        play: plausible error of a reading, ticks.
    """

    bus: ServoBus
    firmware: int
    bears: Ratings

    def __init__(self, options: AxisOptions) -> None:
        self.options = options
        self.table = options.model.family.table
        self.turns = 0
        self.position: int | None = None
        self.seen_ns = self.strained = 0
        self.per_turn = options.model.ticks
        self.near = self.per_turn // 8
        per_radian = self.per_turn / (2 * math.pi)
        self._centre = options.model.family.centre
        self._goal = self._low = self._high = self._centre
        self._most = _MARGIN * options.velocity * options.gear * per_radian
        self.play = _PLAY * per_radian + self._most * _AGE_S
        self._held = round(_HELD * per_radian)
        self._scale = options.direction * options.gear * per_radian

    def __str__(self) -> str:
        return f"servo {self.options.id} ({self.options.name})"

    def angle(self, position: float) -> float:
        """Return the angle of the axis, rad, at a position in the servo's ticks."""
        ahead = position + self.turns * self.per_turn - self._centre
        return self.options.zero + ahead / self._scale

    def ticks(self, angle: float) -> int:
        """Return the goal, in the servo's ticks, nearest to an angle in rad.

        Raises:
            ValueError: the servo cannot count that far.
        """
        ahead = (angle - self.options.zero) * self._scale
        goal = round(self._centre + ahead - self.turns * self.per_turn)
        if abs(goal) > self.options.model.family.goal_limit:
            raise ValueError(f"{self.options.name} cannot go to {goal} ticks")
        return sendable(goal)

    def rate(self, steps: int) -> float:
        """Return the axis' rate, rad/s, at a velocity in the servo's steps."""
        unit = self.options.model.family.velocity_unit
        return steps * unit * self.options.direction / self.options.gear

    def steps(self, velocity: float) -> int:
        """Return a velocity of the servo, rad/s, in its steps."""
        return math.ceil(velocity / self.options.model.family.velocity_unit)

    @property
    def goal(self) -> int:
        """Last sent goal, in the servo's ticks."""
        return self._goal

    @goal.setter
    def goal(self, goal: int) -> None:
        self._goal = goal
        self._low, self._high = min(self._low, goal), max(self._high, goal)

    def believe(self, position: int, now_ns: int) -> None:
        """Accept *position*, in ticks, as that of the servo."""
        self.position, self.seen_ns = position, now_ns
        self._low, self._high = min(position, self._goal), max(position, self._goal)

    def doubt(self, position: int, *, is_driven: bool, now_ns: int | None = None) -> str:
        """Return why the servo cannot be at *position*, or an empty string.

        Args:
            position: reported position, ticks.
            is_driven: whether its torque is on.
            now_ns: time of the request; ``None`` if it may have been turned by hand for any time.
        """
        ahead = position - self._goal
        if is_driven and self._is_turns_away(ahead):
            return f"reports a jump of {abs(ahead)} ticks from its goal"
        if self.position is None:
            return ""
        jump = position - self.position
        if is_driven:
            is_possible = self._low - self.play <= position <= self._high + self.play
        elif now_ns is not None:
            reach = self.play + self._most * max(0, now_ns - self.seen_ns) * 1e-9
            is_possible = abs(jump) <= min(reach, self.near)
        else:
            # By hand it reaches any angle, but hardly the same one after whole turns.
            is_possible = not self._is_turns_away(jump)
        return "" if is_possible else f"reports a jump of {abs(jump)} ticks"

    def _is_turns_away(self, jump: float) -> bool:
        turns = round(jump / self.per_turn)
        return turns != 0 and abs(jump - turns * self.per_turn) <= self.play

    def get(self, register: Register, attempts: int = ATTEMPTS) -> int:
        """Return a register; raise :class:`LinkError` if the servo does not answer."""
        return self.bus.read(self.options.id, register, attempts=attempts)

    def put(self, register: Register, value: int) -> None:
        """Write a register; raise :class:`LinkError` if the servo does not answer."""
        self.bus.write(self.options.id, register, value)

    def row(self, size: int) -> Row:
        """Return the servo's part of a group read of *size* bytes."""
        return Row(self.options.id, self.options.model.family.indirect_data, size)

    def present_position(self) -> int:
        """Return the servo's position in its ticks, outside of the cycle.

        Raises:
            LinkError: it does not answer.
            DoubtError: it reports an impossible position.
        """
        last, problem = None, "does not report the same position twice"
        for _ in range(PATIENT_ATTEMPTS):
            position = self.get(self.table.position, PATIENT_ATTEMPTS)
            if last is not None and abs(position - last) <= self.play:
                is_driven = bool(self.get(self.table.torque, PATIENT_ATTEMPTS))
                if is_driven:
                    self.goal = self.get(self.table.goal, PATIENT_ATTEMPTS)
                problem = self.doubt(position, is_driven=is_driven)
                if not problem:
                    return position
            last = position
        raise DoubtError(
            f"{self} {problem}; nothing is moved by that: turn the axis a little by hand with the "
            "supply off, then reset"
        )

    def identify(self) -> None:
        """Find the servo, and read its limits.

        Raises:
            LinkError: it does not answer.
            DeviceFaultError: it is another model.
        """
        pings = (self.bus.ping(self.options.id) for _ in range(PATIENT_ATTEMPTS))
        found = next(filter(None, pings), None)
        if found is None:
            raise LinkError(
                f"{self} does not answer; look at its cable, its supply, its id and its line speed"
            )
        number, self.firmware = found
        model = self.options.model
        if number != model.number:
            raise DeviceFaultError(
                f"{self} is model {number}, configured is {model.name} ({model.number})"
            )
        table, unit = self.table, model.current_unit
        lowest, highest = VOLT * self.get(table.min_voltage), VOLT * self.get(table.max_voltage)
        current = unit * self.get(table.current_limit) if unit else 0.0
        self.bears = Ratings(self.get(table.temperature_limit), lowest, highest, current)

    def why_not_fast(self) -> str:
        """Return why the servo does not support fast reads, or an empty string."""
        needed = self.options.model.family.fast_firmware
        if needed is None:
            return f"servo {self.options.id} is not known to answer fast reads"
        if self.firmware >= needed:
            return ""
        return f"servo {self.options.id} has firmware {self.firmware}, fast reads need {needed}"

    def clear_error(self, sleep: Sleep) -> None:
        """Restart the servo if it reports a hardware error.

        Raises:
            LinkError: it does not come back.
            DeviceFaultError: the error is still there.
        """
        if not self.get(self.table.hardware_error):
            return
        self.bus.reboot(self.options.id)
        for _ in range(_BOOT_STEPS):
            sleep(_BOOT_STEP_S)
            if self.bus.ping(self.options.id) is not None:
                break
        else:
            raise LinkError(f"{self} did not come back after a reboot")
        if bits := self.get(self.table.hardware_error):
            raise DeviceFaultError(f"{self} still reports {explain_error(bits)} after a reboot")

    @property
    def mode(self) -> int:
        """The operating mode that counts turns, with a current limit if configured."""
        return EXTENDED_POSITION if self.options.current_limit is None else CURRENT_POSITION

    def foreign(self) -> dict[str, tuple[int, int]]:
        """Return the servo's own settings that differ, with present and required values, by name.

        These are settings that other software may use.
        """
        wanted = {"homing_offset": 0, "drive_mode": 0, "operating_mode": self.mode}
        table = self.table._asdict()
        pairs = {name: (self.get(table[name]), value) for name, value in wanted.items()}
        return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}

    def _has_map(self) -> bool:
        """Return whether the servo has the map of the cyclic read."""
        mapped = b"".join(address.to_bytes(2, "little") for address in self._addresses)
        whole = Register(self.options.model.family.indirect_address, len(mapped))
        return self.get(whole, PATIENT_ATTEMPTS) == int.from_bytes(mapped, "little")

    def has_kept_power(self) -> bool:
        """Return whether the servo has counted turns since its configuration."""
        is_counting = self.get(self.table.operating_mode) == self.mode
        return self.options.model.family.forgets_map and is_counting and self._has_map()

    def configure(self) -> None:
        """Correct the servo's settings; write permanent ones only if they differ.

        Raises:
            DoubtError: its watchdog has stopped it, and it reports an impossible position.
            DeviceFaultError: it does not accept a setting.
        """
        table, options, family = self.table, self.options, self.options.model.family
        if self.get(table.return_level) != RETURN_LEVEL:
            self.put(table.return_level, RETURN_LEVEL)
        self.quiet_watchdog()
        permanent = {table.return_delay: 0, table.drive_mode: 0, table.operating_mode: self.mode,
                     table.homing_offset: 0}  # fmt: skip
        wrong = {one: value for one, value in permanent.items() if self.get(one) != value}
        has_map = self._has_map()
        if wrong or not (has_map or family.forgets_map):
            self.put(table.torque, 0)
        for register, value in wrong.items():
            self._set(register, value)
        if not has_map:
            for k, address in enumerate(self._addresses):
                self.put(Register(family.indirect_address + 2 * k, 2), address)
            if not self._has_map():
                raise DeviceFaultError(f"{self} does not keep the map of its readings")
        self._set(table.profile_acceleration, 0)
        # The servo knows no limit but its profile: allow no more than orientd needs if an obstacle
        # comes free.
        fastest = self.steps(_PROFILE_MARGIN * options.velocity * options.gear)
        self._set(table.profile_velocity, min(fastest, self.get(table.velocity_limit)))
        if options.current_limit is not None:
            most, unit = self.bears.current, options.model.current_unit
            if options.current_limit > most:
                raise DeviceFaultError(
                    f"{self} gives {most:.2f} A at most, current_limit is "
                    f"{options.current_limit:g} A"
                )
            self._set(table.goal_current, round(options.current_limit / unit))

    @property
    def _addresses(self) -> tuple[int, ...]:
        return self.table.block + self.table.health

    def _set(self, register: Register, value: int) -> None:
        """Write a setting and check it by reading it back.

        Raises:
            DeviceFaultError: the servo has not accepted it.
        """
        self.put(register, value)
        if (kept := self.get(register)) != value:
            raise DeviceFaultError(
                f"{self} keeps {kept} at address {register.address}, asked was {value}"
            )

    def quiet_watchdog(self) -> bool:
        """Switch the watchdog off; return whether it had tripped.

        A tripped servo has stopped, but may keep its old goal and move there later.  So its goal
        becomes its position.

        Raises:
            DoubtError: it has tripped, and reports an impossible position; it stays stopped.
        """
        state = self.get(self.table.watchdog)
        if state == WATCHDOG_TRIPPED:
            # Read first, and wait for no answer between the two writes: until its new goal arrives,
            # the servo moves to the old one.  The acknowledged writes show that both arrived.
            goal = sendable(self.present_position())
            writes = (self.table.watchdog, 0), (self.table.goal, goal)
            self.bus.sync_write([(self.options.id, *each) for each in writes])
            for register, value in writes:
                self.put(register, value)
            self.goal = goal
        elif state:
            self.put(self.table.watchdog, 0)
        return state == WATCHDOG_TRIPPED

    def arm_watchdog(self, milliseconds: int) -> None:
        """Make the servo stop after a silence; 0 switches that off."""
        self.put(self.table.watchdog, -(-milliseconds // _WATCHDOG_UNIT_MS))

    def check(self) -> None:
        """Refuse a servo that reports an error, or whose axis is outside its limits.

        Raises:
            DeviceFaultError: it does, it is, or it reports an impossible position.
        """
        if bits := self.get(self.table.hardware_error, PATIENT_ATTEMPTS):
            raise DeviceFaultError(f"{self} reports {explain_error(bits)}; reset it")
        self.check_angle(self.angle(self.present_position()))

    def check_angle(self, angle: float) -> None:
        """Refuse an angle, rad, outside the limits of the axis, by more than the servo's play."""
        options = self.options
        slack = max(_ANGLE_SLACK, options.resolution)
        if not options.low - slack <= angle <= options.high + slack:
            raise DeviceFaultError(
                f"{options.name} would be at {math.degrees(angle):.2f} deg, allowed are "
                f"{math.degrees(options.low):.2f} to {math.degrees(options.high):.2f} deg"
            )

    def engage(self) -> bool:
        """Switch the torque on with the goal at the position; return whether it had been off.

        A servo that already holds keeps its goal.
        """
        position = self.present_position()
        goal = self.get(self.table.goal, PATIENT_ATTEMPTS)
        was_on = bool(self.get(self.table.torque, PATIENT_ATTEMPTS))
        if not (was_on and abs(goal - position) <= self._held):
            self.put(self.table.goal, sendable(position))
            self.put(self.table.torque, 1)
            if not self.get(self.table.torque, PATIENT_ATTEMPTS):
                bits = self.get(self.table.hardware_error, PATIENT_ATTEMPTS)
                why = f"it reports {explain_error(bits)}; reset it" if bits else "it says no more"
                raise DeviceFaultError(f"{self} does not switch its torque on: {why}")
            goal = self.get(self.table.goal, PATIENT_ATTEMPTS)
            if abs(goal - position) > self._held:
                if not was_on:
                    self.release()
                raise DeviceFaultError(
                    f"{self} has its goal {goal - position} ticks away from where it is"
                )
        self.goal = goal
        self.believe(position, self.seen_ns)
        return not was_on

    def hold(self, *, stands: bool) -> None:
        """Leave the servo at its goal, its watchdog off.

        Args:
            stands: whether to hold its position instead.

        Raises:
            DeviceError: it could not be reached.
        """
        if not self.quiet_watchdog() and stands:
            with suppress(DoubtError):
                goal = sendable(self.present_position())
                self.put(self.table.goal, goal)
                self.goal = goal
        if stands:
            self.put(self.table.profile_velocity, self.steps(PARK_RATE))

    def go_slowly(self, angle: float) -> None:
        """Send the axis to *angle*, rad, at the rate of parking."""
        acceleration = _PARK_ACCELERATION / self.options.model.family.acceleration_unit
        self.put(self.table.profile_acceleration, math.ceil(acceleration))
        self.put(self.table.profile_velocity, self.steps(PARK_RATE))
        self.goal = self.ticks(angle)
        self.put(self.table.goal, self.goal)

    def is_near_goal(self, position: int) -> bool:
        """Return whether *position*, in its ticks, is as close to the goal as a load allows."""
        return abs(position - self.goal) <= self._held

    def let_go(self) -> None:
        """Switch the torque off, so that the axis can be turned by hand, and the watchdog."""
        self.put(self.table.watchdog, 0)
        self.put(self.table.torque, 0)

    def release(self) -> None:
        """Switch the torque off if the servo can still be reached."""
        with suppress(DeviceError):
            self.put(self.table.torque, 0)
