"""One emulated servo: its memory, its instructions, and its faults.

The documents leave some behaviour open.  Here, torque on sets the goal to the present position.  In
a latched shutdown, a write of torque answers with the alert alone and changes nothing.  A write of
several registers is done whole or not at all.  Gaps of the table read as zero.  Booting takes 0.3
s.  The reverse bit of the drive mode is not modelled.  A servo that its watchdog stopped keeps its
goal.  It goes there once the watchdog is cleared, unless it gets another goal first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from emulated_dynamixel.motion import OVERLOAD_S, TICKS_PER_RADIAN, Aim, Shaft
from emulated_dynamixel.packet import ALERT, ErrorNumber, Instruction
from emulated_dynamixel.table import (
    ACCELERATION_UNIT,
    CENTRE,
    EEPROM_END,
    MODES,
    TICKS_PER_TURN,
    VELOCITY_UNIT,
    XM430_W350,
    Register,
    ServoModel,
)

BOOT_NS = 300_000_000
WATCHDOG_UNIT_NS = 20_000_000
WATCHDOG_TRIPPED = 0xFF
VOLTAGE, OVERHEATING, OVERLOAD = 1 << 0, 1 << 2, 1 << 5

_CURRENT, _VELOCITY, _POSITION, _EXTENDED, _CURRENT_POSITION, _PWM = MODES
_POSITIONING = (_POSITION, _EXTENDED, _CURRENT_POSITION)
_POSITION_REGISTER = 132
_LIMIT_OF_GOAL = {100: "pwm limit", 102: "current limit", 104: "velocity limit"}

CLEAR_TURNS = bytes.fromhex("0144584c22")


@dataclass(slots=True)
class Lie:
    """A wrong position that a servo reports.

    Attributes:
        offset: error in ticks.
        at: the only position at which it applies, in ticks; ``None`` for all.
        remaining: number of wrong readings; ``None`` is unlimited.
    """

    offset: int
    at: int | None = None
    remaining: int | None = None


class EmulatedServo:
    """A servo on the bus.

    Attributes:
        model: its model.
        shaft: its mechanics; tests jam or load it there.
        is_connected: whether its cable and its supply are connected.
        supply: steps of 0.1 V.
        temperature: degrees Celsius.
        lie: error of the reported positions; ``None`` for none.
        keeps_goal: whether it keeps an old goal when the torque comes on.
    """

    def __init__(
        self, servo_id: int, model: ServoModel = XM430_W350, *, baud_index: int = 3, now_ns: int = 0
    ) -> None:
        self.model = model
        self.is_connected = True
        self.lie: Lie | None = None
        self.keeps_goal = False
        self.supply, self.temperature = model.voltage, 32
        self._memory = bytearray(model.end)
        self._data_of = {
            addresses + 2 * k: block + k
            for addresses, block, count in model.indirect
            for k in range(count)
        }
        self._source = list(range(model.end))
        self._owner: dict[int, Register] = {}
        for register in model.registers.values():
            for offset in range(register.size):
                self._owner[register.address + offset] = register
            self._store(register, register.default)
        self._memory[7] = servo_id
        self._memory[8] = baud_index
        self.registered: tuple[int, bytes] | None = None
        self._ready_ns = now_ns
        self._boot_ns = now_ns
        self._fed_ns = now_ns
        self._planned_goal: int | None = None
        self._planned = (0.0, 0.0)
        self._stopped_at = 0.0
        self.shaft = Shaft(float(CENTRE), now_ns)

    @property
    def id(self) -> int:
        """The number it answers to."""
        return self._memory[7]

    @property
    def baud_index(self) -> int:
        """Its line speed, an index of ``BAUD_RATES``."""
        return self._memory[8]

    @property
    def return_delay_ns(self) -> int:
        """Its delay before an answer."""
        return self._memory[9] * 2_000

    @property
    def return_level(self) -> int:
        """0 answers pings only, 1 also reads, 2 everything."""
        return self._memory[68]

    @property
    def error_bits(self) -> int:
        """The alert bit, set while there is a hardware error."""
        return ALERT if self._memory[70] else 0

    @property
    def is_torque_on(self) -> bool:
        """Whether the motor is driven."""
        return bool(self._memory[64])

    def is_listening(self, now_ns: int) -> bool:
        """Whether it is connected and has booted."""
        return self.is_connected and now_ns >= self._ready_ns

    def value(self, name: str) -> int:
        """Return a register's content by *name*, for tests and displays."""
        stored, address = self.model.places[name]
        value: int = stored.unpack_from(self._memory, address)[0]
        return value

    def carry_out(self, instruction: int, parameters: bytes, now_ns: int) -> tuple[int, bytes]:
        """Execute one instruction; return an error number and the content of the answer."""
        address = int.from_bytes(parameters[:2], "little")
        match instruction:
            case Instruction.PING:
                number = self.model.number.to_bytes(2, "little")
                return ErrorNumber.NONE, number + bytes([self.value("firmware version")])
            case Instruction.READ if len(parameters) == 4:
                return self.read(address, int.from_bytes(parameters[2:], "little"), now_ns)
            case Instruction.WRITE if len(parameters) >= 3:
                return self.write(address, parameters[2:], now_ns), b""
            case Instruction.REG_WRITE if len(parameters) >= 3:
                return self.register_write(address, parameters[2:], now_ns), b""
            case Instruction.READ | Instruction.WRITE | Instruction.REG_WRITE:
                return ErrorNumber.DATA_LENGTH, b""
            case Instruction.ACTION:
                return self.action(now_ns), b""
            case Instruction.CLEAR if parameters == CLEAR_TURNS:
                return self.clear_turns(now_ns), b""
            case Instruction.CLEAR:
                return ErrorNumber.DATA_RANGE, b""
            case Instruction.REBOOT | Instruction.FACTORY_RESET:
                return ErrorNumber.NONE, b""  # the bus continues once it has answered
        return ErrorNumber.INSTRUCTION, b""

    def read(self, address: int, count: int, now_ns: int) -> tuple[int, bytes]:
        """Return an error number and *count* bytes from *address* on."""
        if count < 1 or address + count > self.model.end:
            return ErrorNumber.ACCESS, b""
        self.advance(now_ns)
        self.refresh(now_ns)
        sources = self._source[address : address + count]
        if self.lie is not None and _POSITION_REGISTER in sources:
            self._tell_lie(self.lie)
        return ErrorNumber.NONE, bytes(map(self._memory.__getitem__, sources))

    def _tell_lie(self, lie: Lie) -> None:
        position = self.value("present position")
        if lie.remaining == 0 or lie.at not in {None, position}:
            return
        if lie.remaining is not None:
            lie.remaining -= 1
        self._set(_POSITION_REGISTER, position + lie.offset)

    def write(self, address: int, content: bytes, now_ns: int) -> int:
        """Write *content* from *address* on, whole or not at all; return an error number."""
        if not content:
            return ErrorNumber.DATA_LENGTH
        if address + len(content) > self.model.end:
            return ErrorNumber.ACCESS
        self.advance(now_ns)
        error, changes = self._collect(address, content)
        if error:
            return error
        for register, value in changes:
            self._apply(register, value, now_ns)
        return ErrorNumber.NONE

    def register_write(self, address: int, content: bytes, now_ns: int) -> int:
        """Store a write for :meth:`action`; return an error number."""
        self.advance(now_ns)
        if not content or address + len(content) > self.model.end:
            return ErrorNumber.ACCESS if content else ErrorNumber.DATA_LENGTH
        error, _ = self._collect(address, content)
        if not error:
            self.registered = (address, content)
            self._memory[69] = 1
        return error

    def action(self, now_ns: int) -> int:
        """Execute the stored write; return an error number."""
        if self.registered is None:
            return ErrorNumber.INSTRUCTION
        address, content = self.registered
        self.registered = None
        self._memory[69] = 0
        return self.write(address, content, now_ns)

    def clear_turns(self, now_ns: int) -> int:
        """Clear whole turns if the shaft stands still; return an error number."""
        self.advance(now_ns)
        if self._is_moving():
            return ErrorNumber.RESULT_FAIL
        self._lose_turns()
        return ErrorNumber.NONE

    def feed_watchdog(self, now_ns: int) -> None:
        """Record that an instruction was received."""
        self.advance(now_ns)
        self._fed_ns = now_ns

    def reboot(self, now_ns: int, *, boot_ns: int = BOOT_NS) -> None:
        """Restart: RAM at its defaults, turns lost, silent for *boot_ns*."""
        self.advance(now_ns)
        for register in self.model.registers.values():
            if register.address >= EEPROM_END:
                self._store(register, register.default)
        self.registered = None
        self._lose_turns()
        self.shaft.speed = self.shaft.strain_s = 0.0
        self.shaft.settle()
        self._boot_ns = now_ns
        self._ready_ns = now_ns + boot_ns

    def factory_reset(self, option: int, now_ns: int) -> None:
        """Reset the EEPROM; *option* 1 keeps the id, 2 the id and the line speed."""
        kept = {7: self.id if option in {1, 2} else 1, 8: self.baud_index if option == 2 else 1}
        for register in self.model.registers.values():
            if register.address < EEPROM_END:
                self._store(register, kept.get(register.address, register.default))
        self.reboot(now_ns)

    def disconnect(self, now_ns: int) -> None:
        """Unplug the cable: the motor loses its supply."""
        self.advance(now_ns)
        self._memory[64] = 0
        self.shaft.speed = 0.0
        self.is_connected = False

    def connect(self, now_ns: int) -> None:
        """Plug the cable in again; it boots."""
        if not self.is_connected:
            self.is_connected = True
            self.reboot(now_ns)

    def fail(self, bits: int, now_ns: int) -> None:
        """Report a hardware error; those in the shutdown mask switch the torque off."""
        self.advance(now_ns)
        self._fail(bits)

    def _fail(self, bits: int) -> None:
        self._memory[70] |= bits
        if bits & self._memory[63]:
            self._memory[64] = 0

    def advance(self, now_ns: int) -> None:
        """Advance the time: supply, heat, watchdog, motor, overload."""
        low, high = self.value("min voltage limit"), self.value("max voltage limit")
        bits = (not low <= self.supply <= high) * VOLTAGE
        bits |= (self.temperature > self.value("temperature limit")) * OVERHEATING
        if bits & ~self._memory[70]:
            self._fail(bits)
        watchdog = self._memory[98]
        if 0 < watchdog < WATCHDOG_TRIPPED and self.is_torque_on:
            trip_ns = self._fed_ns + watchdog * WATCHDOG_UNIT_NS
            if now_ns > trip_ns:
                self.shaft.advance(trip_ns, self._aim())
                self._memory[98] = WATCHDOG_TRIPPED
                self._stopped_at = self.shaft.position
                self._set(104, 0)
                self.shaft.settle()
        if not self.shaft.is_due(now_ns):
            return
        self.shaft.advance(now_ns, self._aim())
        if self.shaft.strain_s >= OVERLOAD_S and not self._memory[70] & OVERLOAD:
            self._fail(OVERLOAD)

    def _collect(self, address: int, content: bytes) -> tuple[int, list[tuple[Register, int]]]:
        targets = self._source[address : address + len(content)]
        changes: list[tuple[Register, int]] = []
        at = 0
        while at < len(content):
            target = targets[at]
            register = self._owner.get(target)
            if register is None and target in self._data_of.values():
                at += 1  # unmapped indirect data: nothing is stored
                continue
            if register is None or not register.writable:
                return ErrorNumber.ACCESS, []
            expected = list(range(register.address, register.address + register.size))
            if targets[at : at + register.size] != expected:
                return ErrorNumber.DATA_LENGTH, []
            raw = content[at : at + register.size]
            value = int.from_bytes(raw, "little", signed=register.is_signed)
            if error := self._check(register, value):
                return error, []
            changes.append((register, value))
            at += register.size
        return ErrorNumber.NONE, changes

    def _check(self, register: Register, value: int) -> int:
        address = register.address
        if address < EEPROM_END and self.is_torque_on:
            return ErrorNumber.ACCESS
        if not register.low <= value <= register.high:
            return ErrorNumber.DATA_RANGE
        if address == 11 and value not in MODES:
            return ErrorNumber.DATA_RANGE
        if 100 <= address < 120 and self._memory[98] == WATCHDOG_TRIPPED:
            return ErrorNumber.DATA_RANGE
        if address in _LIMIT_OF_GOAL and abs(value) > self.value(_LIMIT_OF_GOAL[address]):
            return ErrorNumber.DATA_LIMIT
        if address == 116 and self._memory[11] == _POSITION:
            low, high = self.value("min position limit"), self.value("max position limit")
            if not low <= value <= high:
                return ErrorNumber.DATA_LIMIT
        return ErrorNumber.NONE

    def _apply(self, register: Register, value: int, now_ns: int) -> None:
        address = register.address
        if address == 64 and value:
            if self._memory[70] & self._memory[63] or self.is_torque_on:
                return
            if self._memory[11] == _POSITION:
                self._lose_turns()
            if not self.keeps_goal:
                self._store_goal(self.shaft.position)
            self.shaft.settle()
            self._fed_ns = now_ns
        previous = self._memory[address]
        self._store(register, value)
        if address == 11 and value != previous:
            self._set(108, 0)
            self._set(112, 0)
            self._set(36, 885)
            self._set(100, self.value("pwm limit"))
            self._set(102, self.value("current limit"))
            if value == _POSITION:
                self._lose_turns()
            self._store_goal(self.shaft.position)
        elif address == 98 and value == 0:
            self.shaft.settle()

    def _lose_turns(self) -> None:
        turns = math.floor(self.shaft.position / TICKS_PER_TURN)
        self.shaft.shift(-turns * TICKS_PER_TURN)
        self._store_goal(self.shaft.position)

    def _aim(self) -> Aim | None:
        if not self.is_torque_on:
            return None
        mode = self._memory[11]
        limit = self.model.no_load_speed * TICKS_PER_RADIAN
        aim = Aim(speed_limit=limit * abs(self.value("goal pwm")) / 885)
        most = self.value("current limit")
        push = max(-most, min(most, self.value("goal current"))) / max(1, most)
        if mode == _CURRENT_POSITION:
            aim.torque = abs(push)
        acceleration, speed = self.value("profile acceleration"), self.value("profile velocity")
        aim.profile_acceleration = acceleration * ACCELERATION_UNIT * TICKS_PER_RADIAN
        if mode in _POSITIONING:
            goal = self.value("goal position") - self.value("homing offset")
            aim.position = float(goal)
            if self._memory[98] == WATCHDOG_TRIPPED:
                aim.position = self._stopped_at
            aim.profile_speed = speed * VELOCITY_UNIT * TICKS_PER_RADIAN
            if self._memory[10] & 0x04 and speed:
                self._time_profile(aim, goal, speed * 1e-3, acceleration * 1e-3)
        elif mode == _VELOCITY:
            aim.speed = self.value("goal velocity") * VELOCITY_UNIT * TICKS_PER_RADIAN
        elif mode == _PWM:
            aim.speed = self.value("goal pwm") / 885 * limit
            aim.speed_limit = limit
        else:
            aim.speed = push * limit
        if self._memory[98] == WATCHDOG_TRIPPED and aim.position is None:
            aim.speed = 0.0
        return aim

    def _time_profile(self, aim: Aim, goal: int, total_s: float, ramp_s: float) -> None:
        # The profile starts when the goal is new and the reference stands still at its beginning.
        if self._planned_goal != goal:
            self._planned_goal = goal
            distance = abs(goal - self.shaft.reference)
            ramp_s = min(ramp_s, total_s / 2)
            speed = distance / (total_s - ramp_s)
            self._planned = (speed, speed / ramp_s if ramp_s else 0.0)
        aim.profile_speed, aim.profile_acceleration = self._planned

    def _is_moving(self) -> bool:
        threshold = self.value("moving threshold") * VELOCITY_UNIT * TICKS_PER_RADIAN
        return abs(self.shaft.speed) > threshold

    def _store_goal(self, position: float) -> None:
        self._set(116, round(position) + self.value("homing offset"))

    def refresh(self, now_ns: int) -> None:
        """Write the measured values into the registers."""
        shaft = self.shaft
        speed = round(shaft.speed / (VELOCITY_UNIT * TICKS_PER_RADIAN))
        aim = self._aim()
        effort = 0.0
        if aim is not None:
            gap = (
                (aim.speed - shaft.speed) if aim.position is None else aim.position - shaft.position
            )
            scale = aim.speed_limit if aim.position is None else 1024.0
            effort = max(-1.0, min(1.0, gap / scale)) if scale else 0.0
            if shaft.load:
                effort = max(abs(effort), min(1.0, shaft.load)) * (1 if effort >= 0 else -1)
            effort = max(-aim.torque, min(aim.torque, effort))
        self._set(120, (now_ns - self._boot_ns) // 1_000_000 % 32768)
        moving = self._is_moving()
        self._memory[122] = moving
        arrived = aim is not None and aim.position is not None and abs(effort) * 1024 < 10
        ongoing = shaft.reference_speed != 0
        self._memory[123] = arrived | ongoing << 1
        self._set(124, round(effort * 885))
        self._set(126, round(effort * self.value("current limit")))
        self._set(128, speed)
        offset = self.value("homing offset")
        self._set(132, round(shaft.position) + offset)
        self._set(136, round(shaft.reference_speed / (VELOCITY_UNIT * TICKS_PER_RADIAN)))
        self._set(140, round(shaft.reference) + offset)
        self._set(144, self.supply)
        self._memory[146] = self.temperature

    def _set(self, address: int, value: int) -> None:
        self._store(self.model.registers[address], value)

    def _store(self, register: Register, value: int) -> None:
        raw = (value & ((1 << 8 * register.size) - 1)).to_bytes(register.size, "little")
        self._memory[register.address : register.address + register.size] = raw
        if (data := self._data_of.get(register.address)) is not None:
            self._source[data] = value
