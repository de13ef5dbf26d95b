"""The emulated bus: instructions in, answers out at their times.

No input or output here: the owner of the port passes in the host's bytes and takes the answers that
are due.  In the answers to a group each servo waits for the previous one.  If one is silent, so are
all later ones.
"""

from __future__ import annotations

import random
from collections.abc import Iterable

from emulated_dynamixel.line import SerialLine, Wire
from emulated_dynamixel.packet import (
    BROADCAST,
    FAST,
    MAX_LENGTH,
    READS,
    WRITES,
    Damaged,
    ErrorNumber,
    Instruction,
    Packet,
    Parser,
    fast_part,
    group_blocks,
    status,
)
from emulated_dynamixel.servo import EmulatedServo
from emulated_dynamixel.table import BAUD_RATES

_RETURN_LEVEL: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}


class Bus:
    """Servos on one line.

    Attributes:
        servos: by their position on the line; their ids are in their memories.
        line: timing of bytes.
        wire: the answers in transit.
        faults: faults of answers.
        packets: number of received instructions.
    """

    def __init__(
        self,
        servos: Iterable[EmulatedServo],
        *,
        line: SerialLine | None = None,
        rng: random.Random | None = None,
        gap_ns: int = 1_500_000,
    ) -> None:
        self.servos = list(servos)
        self.line = line or SerialLine()
        self.wire = Wire(self.line, rng or random.Random(0))
        self.faults = self.wire.faults
        self.packets = 0
        self._parser = Parser(gap_ns)
        self._host_free_ns = 0

    def servo(self, servo_id: int) -> EmulatedServo:
        """Return the servo with *servo_id*.

        Raises:
            KeyError: it does not exist.
        """
        for servo in self.servos:
            if servo.id == servo_id:
                return servo
        raise KeyError(servo_id)

    def receive(self, octets: bytes, now_ns: int, *, baud: int = 1_000_000) -> None:
        """Receive the bytes that the host wrote at *now_ns* with its port at *baud*."""
        start_ns = max(now_ns, self._host_free_ns)
        self._host_free_ns = start_ns + self.line.duration_ns(len(octets), baud)
        for packet, count in self._parser.feed(octets, now_ns):
            end_ns = start_ns + self.line.duration_ns(count, baud)
            if self.wire.collides(start_ns):
                continue
            self.packets += 1
            listening = [
                servo
                for servo in self.servos
                if servo.is_listening(end_ns) and BAUD_RATES[servo.baud_index] == baud
            ]
            for servo in listening:
                servo.feed_watchdog(end_ns)
            self._dispatch(packet, listening, end_ns, baud)

    def advance(self, now_ns: int) -> None:
        """Advance the time of every servo."""
        for servo in self.servos:
            servo.advance(now_ns)

    def _dispatch(
        self, packet: Packet | Damaged, listening: list[EmulatedServo], now_ns: int, baud: int
    ) -> None:
        by_id = {servo.id: servo for servo in reversed(listening)}
        self.wire.begin_turn(now_ns, baud)
        if isinstance(packet, Damaged):
            if servo := by_id.get(packet.id):
                self._answer(servo, packet.instruction, ErrorNumber.CRC, b"")
        elif packet.instruction in WRITES:
            for servo_id, address, content in group_blocks(packet):
                if servo := by_id.get(servo_id):
                    servo.write(address, content, now_ns)
        elif packet.instruction in READS:
            if packet.id == BROADCAST:
                self._read_group(packet, by_id, now_ns)
        elif packet.instruction != Instruction.STATUS:
            is_broadcast = packet.id == BROADCAST
            for servo_id in sorted(by_id):
                if is_broadcast or servo_id == packet.id:
                    self._single(by_id[servo_id], packet, now_ns)

    def _single(self, servo: EmulatedServo, packet: Packet, now_ns: int) -> None:
        is_broadcast = packet.id == BROADCAST
        is_reset = packet.instruction == Instruction.FACTORY_RESET and packet.parameters
        if is_broadcast and is_reset and packet.parameters == b"\xff":
            return  # newer firmware refuses to reset every id
        error, content = servo.carry_out(packet.instruction, packet.parameters, now_ns)
        if not is_broadcast or packet.instruction == Instruction.PING:
            self._answer(servo, packet.instruction, error, content)
        # These two answer first, then go silent.
        if packet.instruction == Instruction.REBOOT:
            servo.reboot(now_ns)
        elif is_reset:
            servo.factory_reset(packet.parameters[0], now_ns)

    def _answer(self, servo: EmulatedServo, instruction: int, error: int, content: bytes) -> None:
        if servo.return_level >= _RETURN_LEVEL.get(instruction, 2):
            reply = status(servo.id, servo.error_bits | error, content)
            self.wire.answer(servo.id, reply, servo.return_delay_ns)

    def _read_group(self, packet: Packet, by_id: dict[int, EmulatedServo], now_ns: int) -> None:
        is_fast = packet.instruction in FAST
        wanted = group_blocks(packet)
        if is_fast and sum(len(block) for _, _, block in wanted) > MAX_LENGTH:
            return  # no packet holds so much
        blocks = []
        for servo_id, address, block in wanted:
            servo = by_id.get(servo_id)
            if servo is None or not servo.return_level:
                blocks.append((0, servo_id, block))
                continue
            error, content = servo.read(address, len(block), now_ns)
            padded = content.ljust(len(block), b"\0") if is_fast else content
            blocks.append((servo.error_bits | error, servo_id, padded))
        heard = b""
        for place, (error, servo_id, content) in enumerate(blocks):
            servo = by_id.get(servo_id)
            if servo is None or not servo.return_level:
                return
            part = fast_part(blocks, place, heard) if is_fast else status(servo_id, error, content)
            sent = self.wire.answer(servo_id, part, servo.return_delay_ns)
            if not sent:
                return
            heard += sent
