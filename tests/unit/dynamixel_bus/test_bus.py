"""The bus: who answers, in which order and when."""

import random

import pytest
from fast_status import fast_blocks

from emulated_dynamixel import Bus, EmulatedServo, FaultKind, ReplyFault, SerialLine
from emulated_dynamixel.packet import (
    BROADCAST,
    ErrorNumber,
    Instruction,
    Packet,
    Parser,
    crc16,
    encode,
)

S = 1_000_000_000


def three(**settings):
    return Bus([EmulatedServo(1), EmulatedServo(2), EmulatedServo(3)], **settings)


def ask(bus, packet, now_ns=0):
    bus.receive(encode(packet), now_ns)
    found = Parser().feed(bus.wire.take(now_ns + 10 * S), now_ns)
    return [p for p, _ in found if isinstance(p, Packet)]


def test_broadcast_ping_is_answered_by_all_in_order():
    answers = ask(three(), Packet(BROADCAST, Instruction.PING))
    assert [a.id for a in answers] == [1, 2, 3]
    assert answers[0].parameters == b"\0\xfc\x03\x30"


def test_nobody_answers_a_broadcast_write():
    bus = three()
    assert ask(bus, Packet(BROADCAST, Instruction.WRITE, b"\x41\0\1")) == []
    assert all(servo.value("led") for servo in bus.servos)


def test_unknown_instruction_is_an_instruction_error():
    assert ask(three(), Packet(2, 0x77)) == [Packet(2, 0x55, bytes([ErrorNumber.INSTRUCTION]))]


def test_damaged_instruction_is_a_crc_error():
    bus = three()
    raw = bytearray(encode(Packet(2, Instruction.WRITE, b"\x41\0\1")))
    raw[10] ^= 2
    bus.receive(bytes(raw), 0)
    found = [p for p, _ in Parser().feed(bus.wire.take(S), 0)]
    assert found == [Packet(2, 0x55, bytes([ErrorNumber.CRC]))]
    assert not bus.servo(2).value("led")


def test_return_level_silences_writes_then_reads_but_never_pings():
    bus = three()
    for level, answers in ((1, (1, 1, 0)), (0, (1, 0, 0))):
        bus.servo(1).write(68, bytes([level]), 0)
        got = tuple(
            len(ask(bus, packet))
            for packet in (
                Packet(1, Instruction.PING),
                Packet(1, Instruction.READ, b"\x41\0\1\0"),
                Packet(1, Instruction.WRITE, b"\x41\0\1"),
            )
        )
        assert got == answers


def test_registered_writes_wait_for_the_action():
    bus = three()
    for servo in (1, 2):
        ask(bus, Packet(servo, Instruction.REG_WRITE, b"\x41\0\1"))
    assert bus.servo(1).value("registered instruction") == 1
    assert not bus.servo(1).value("led")
    assert ask(bus, Packet(BROADCAST, Instruction.ACTION)) == []
    assert [servo.value("led") for servo in bus.servos] == [1, 1, 0]


def test_action_without_a_registered_write_is_an_instruction_error():
    answers = ask(three(), Packet(1, Instruction.ACTION))
    assert answers[0].parameters == bytes([ErrorNumber.INSTRUCTION])


def test_sync_read_answers_in_the_order_of_the_list():
    answers = ask(three(), Packet(BROADCAST, Instruction.SYNC_READ, b"\x84\0\4\0\3\1\2"))
    assert [a.id for a in answers] == [3, 1, 2]


@pytest.mark.parametrize("instruction", [Instruction.SYNC_READ, Instruction.FAST_SYNC_READ])
def test_one_silent_servo_silences_all_later_ones(instruction):
    bus = three()
    bus.servo(2).disconnect(0)
    bus.receive(encode(Packet(BROADCAST, instruction, b"\x84\0\4\0\1\2\3")), 0)
    raw = bus.wire.take(S)
    assert len(raw) == (15 if instruction == Instruction.SYNC_READ else 8 + 8)


def test_fast_bulk_read_gives_each_servo_its_own_block():
    rows = bytes.fromhex("0184000400 0390000200")
    bus = three()
    bus.receive(encode(Packet(BROADCAST, Instruction.FAST_BULK_READ, rows)), 0)
    blocks = fast_blocks(bus.wire.take(S), [4, 2])
    assert blocks == [(0, 1, b"\0\x08\0\0"), (0, 3, b"\x78\0")]


def test_fast_read_of_more_than_a_packet_holds_is_not_answered():
    assert ask(three(), Packet(BROADCAST, Instruction.FAST_SYNC_READ, b"\0\0\xff\xff\1\2")) == []


def test_bulk_read_that_names_a_servo_twice_is_void():
    rows = bytes.fromhex("0184000400 0190000200")
    assert ask(three(), Packet(BROADCAST, Instruction.BULK_READ, rows)) == []


def test_bulk_write_writes_other_registers_of_each():
    bus = three()
    rows = bytes.fromhex("0141000100 01 024400010001")
    assert ask(bus, Packet(BROADCAST, Instruction.BULK_WRITE, rows)) == []
    assert (bus.servo(1).value("led"), bus.servo(2).value("status return level")) == (1, 1)


def test_sync_write_that_one_servo_refuses_is_silent_and_done_by_the_others():
    bus = three()
    for servo in (1, 2):
        bus.servo(servo).write(11, b"\4", 0)
        bus.servo(servo).write(64, b"\1", 0)
    goals = b"\x74\0\4\0" + b"\1\xff\xff\xff\x7f" + b"\2\0\0\0\0"
    assert ask(bus, Packet(BROADCAST, Instruction.SYNC_WRITE, goals)) == []
    assert [bus.servo(i).value("goal position") for i in (1, 2)] == [2048, 0]


def test_alert_is_in_every_status():
    bus = three()
    bus.servo(1).fail(1 << 5, 0)
    for packet in (Packet(1, Instruction.PING), Packet(1, Instruction.READ, b"\x46\0\1\0")):
        assert ask(bus, packet)[0].parameters[0] == 0x80


def test_reboot_answers_first_then_goes_silent():
    bus = three()
    assert len(ask(bus, Packet(1, Instruction.REBOOT))) == 1
    assert ask(bus, Packet(1, Instruction.PING), S // 10) == []
    assert len(ask(bus, Packet(1, Instruction.PING), S // 2)) == 1


def test_factory_reset_of_all_with_everything_is_refused():
    bus = three()
    ask(bus, Packet(BROADCAST, Instruction.FACTORY_RESET, b"\xff"))
    assert [servo.id for servo in bus.servos] == [1, 2, 3]


def test_servo_at_another_line_speed_hears_nothing():
    bus = three()
    bus.receive(encode(Packet(1, Instruction.PING)), 0, baud=57600)
    assert bus.wire.take(S) == b""


def test_any_instruction_feeds_every_watchdog():
    bus = three()
    bus.servo(1).write(64, b"\1", 0)
    bus.servo(1).write(98, b"\5", 0)
    for k in range(20):
        ask(bus, Packet(3, Instruction.PING), k * S // 20)
    assert bus.servo(1).value("bus watchdog") == 5


def test_answers_take_the_time_of_the_line():
    bus = three(line=SerialLine(is_paced=True))
    for servo in bus.servos:
        servo.write(9, b"\0", 0)
    bus.receive(encode(Packet(BROADCAST, Instruction.SYNC_READ, b"\x7e\0\x0a\0\1\2\3")), 0)
    # 17 bytes out, three times 50 us of turnaround and 21 bytes in, at 10 us a byte
    assert bus.wire.take(170_000 + 3 * (50_000 + 210_000) - 1).count(b"\xff\xff\xfd\0") == 2
    assert bus.wire.due_ns() == 170_000 + 3 * (50_000 + 210_000)


def test_return_delay_counts_for_each_servo():
    bus = three(line=SerialLine(is_paced=True))
    bus.receive(encode(Packet(BROADCAST, Instruction.SYNC_READ, b"\x7e\0\x0a\0\1\2")), 0)
    bus.wire.take(160_000 + 550_000 + 210_000)
    assert bus.wire.due_ns() == 160_000 + 2 * (550_000 + 210_000)


def test_instruction_into_an_answer_spoils_both():
    bus = three(line=SerialLine(is_paced=True))
    bus.receive(encode(Packet(1, Instruction.PING)), 0)
    bus.receive(encode(Packet(2, Instruction.PING)), 700_000)
    assert bus.wire.collisions == 1
    assert b"\xff\xff\xfd\0\1" not in bus.wire.take(S)


def test_late_answer_holds_back_those_behind_it():
    bus = three()
    bus.faults.add(1, ReplyFault(FaultKind.DELAY, remaining=1, delay_ns=S))
    bus.receive(encode(Packet(1, Instruction.PING)), 0)
    bus.receive(encode(Packet(2, Instruction.PING)), 1000)
    assert bus.wire.take(S - 1) == b""
    answers = [p.id for p, _ in Parser().feed(bus.wire.take(S), 0)]
    assert answers == [1, 2]


def test_faults_hit_as_often_as_they_say():
    bus = three(rng=random.Random(3))
    bus.faults.add(1, ReplyFault(FaultKind.DROP, probability=0.25))
    answered = sum(len(ask(bus, Packet(1, Instruction.PING), k * S)) for k in range(2000))
    assert 1430 < answered < 1570


def test_corrupt_and_truncated_answers_are_never_accepted():
    for kind in (FaultKind.CORRUPT, FaultKind.TRUNCATE):
        bus = three(rng=random.Random(4))
        bus.faults.add(1, ReplyFault(kind))
        assert sum(len(ask(bus, Packet(1, Instruction.PING), k * S)) for k in range(300)) == 0


def test_servos_of_a_fast_read_answer_for_damage_that_they_heard():
    """The last CRC agrees, and that of the damaged block does not."""
    bus = three(rng=random.Random(4))
    bus.faults.add(1, ReplyFault(FaultKind.CORRUPT))
    for k in range(20):
        bus.receive(
            encode(Packet(BROADCAST, Instruction.FAST_SYNC_READ, b"\x84\0\4\0\1\2\3")), k * S
        )
        answer = bus.wire.take(k * S)
        assert crc16(answer[:-2]) == int.from_bytes(answer[-2:], "little")
        assert crc16(answer[:14]) != int.from_bytes(answer[14:16], "little")


def test_disconnected_servo_loses_torque_and_comes_back_booted():
    bus = three()
    servo = bus.servo(1)
    servo.write(64, b"\1", 0)
    servo.disconnect(S)
    assert ask(bus, Packet(1, Instruction.PING), S) == []
    servo.connect(2 * S)
    assert ask(bus, Packet(1, Instruction.PING), 2 * S) == []
    assert len(ask(bus, Packet(1, Instruction.PING), 3 * S)) == 1
    assert not servo.is_torque_on


def test_time_passes_for_every_servo():
    bus = three()
    for servo in bus.servos:
        servo.write(11, b"\4", 0)
        servo.write(64, b"\1", 0)
        servo.write(116, (4000).to_bytes(4, "little"), 0)
    bus.advance(3 * S)
    assert [round(servo.shaft.position) for servo in bus.servos] == [4000] * 3


def test_two_instructions_in_one_write_are_heard_one_after_the_other():
    bus = three(line=SerialLine(is_paced=True, has_collisions=False))
    ping = encode(Packet(1, Instruction.PING)), encode(Packet(2, Instruction.PING))
    bus.receive(b"".join(ping), 0)
    first = bus.wire.due_ns()
    # 10 bytes, turnaround and return delay, 14 bytes, of 10 microseconds each.
    assert first == 100_000 + 50_000 + 500_000 + 140_000
    assert len(bus.wire.take(first)) == 14
    assert bus.wire.due_ns() == first + 100_000
