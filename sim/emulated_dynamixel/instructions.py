"""What each instruction does to the servos it reaches."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from emulated_dynamixel.packet import ErrorNumber, Instruction
from emulated_dynamixel.servo import CLEAR_TURNS, EmulatedServo

Action = Callable[[EmulatedServo, bytes, int], tuple[int, bytes]]


def _word(octets: bytes, at: int) -> int:
    return int.from_bytes(octets[at : at + 2], "little")


def _ping(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:  # noqa: ARG001
    return ErrorNumber.NONE, servo.model.number.to_bytes(2, "little") + bytes(
        [servo.value("firmware version")]
    )


def _read(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:
    if len(parameters) != 4:
        return ErrorNumber.DATA_LENGTH, b""
    return servo.read(_word(parameters, 0), _word(parameters, 2), now_ns)


def _write(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:
    if len(parameters) < 3:
        return ErrorNumber.DATA_LENGTH, b""
    return servo.write(_word(parameters, 0), parameters[2:], now_ns), b""


def _register_write(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:
    if len(parameters) < 3:
        return ErrorNumber.DATA_LENGTH, b""
    return servo.register_write(_word(parameters, 0), parameters[2:], now_ns), b""


def _action(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:  # noqa: ARG001
    return servo.action(now_ns), b""


def _clear(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:
    if parameters != CLEAR_TURNS:
        return ErrorNumber.DATA_RANGE, b""
    return servo.clear_turns(now_ns), b""


def _nothing(servo: EmulatedServo, parameters: bytes, now_ns: int) -> tuple[int, bytes]:  # noqa: ARG001
    return ErrorNumber.NONE, b""


def sync_write(parameters: bytes, by_id: Mapping[int, EmulatedServo], now_ns: int) -> None:
    """Write the same registers of many servos; nobody answers."""
    address, count = _word(parameters, 0), _word(parameters, 2)
    for at in range(4, len(parameters) - count, count + 1):
        if servo := by_id.get(parameters[at]):
            servo.write(address, parameters[at + 1 : at + 1 + count], now_ns)


def bulk_write(parameters: bytes, by_id: Mapping[int, EmulatedServo], now_ns: int) -> None:
    """Write other registers of each servo; nobody answers."""
    at = 0
    while at + 5 <= len(parameters):
        count = _word(parameters, at + 3)
        if servo := by_id.get(parameters[at]):
            servo.write(_word(parameters, at + 1), parameters[at + 5 : at + 5 + count], now_ns)
        at += 5 + count


def sync_list(parameters: bytes) -> list[tuple[int, int, int]]:
    """Return ``(id, address, count)`` of each servo that a sync read asks."""
    address, count = _word(parameters, 0), _word(parameters, 2)
    return [(servo, address, count) for servo in parameters[4:]]


def bulk_list(parameters: bytes) -> list[tuple[int, int, int]]:
    """Return ``(id, address, count)`` of each servo that a bulk read asks."""
    rows = [
        (parameters[at], _word(parameters, at + 1), _word(parameters, at + 3))
        for at in range(0, len(parameters) - 4, 5)
    ]
    # Each servo once: a second mention makes the instruction void.
    return rows if len({row[0] for row in rows}) == len(rows) else []


SINGLE: Mapping[int, Action] = {
    Instruction.PING: _ping,
    Instruction.READ: _read,
    Instruction.WRITE: _write,
    Instruction.REG_WRITE: _register_write,
    Instruction.ACTION: _action,
    Instruction.CLEAR: _clear,
    Instruction.REBOOT: _nothing,
    Instruction.FACTORY_RESET: _nothing,
}
"""By instruction: what one servo does, returning an error number and the content of its answer."""
