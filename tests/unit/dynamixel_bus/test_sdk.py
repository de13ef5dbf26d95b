"""The vendor's SDK over the port with virtual time, every instruction of it."""

import pytest

sdk = pytest.importorskip("dynamixel_sdk")

from emulated_dynamixel import (  # noqa: E402
    XL330_M288,
    Bus,
    EmulatedServo,
    ManualClock,
    SerialLine,
    VirtualPort,
)
from emulated_dynamixel.packet import Instruction  # noqa: E402

COMM_SUCCESS, COMM_RX_TIMEOUT = 0, -3001


@pytest.fixture
def bus():
    servos = [EmulatedServo(1), EmulatedServo(2), EmulatedServo(3, XL330_M288)]
    for servo in servos:
        servo.write(9, b"\0", 0)
        servo.write(11, b"\4", 0)
    return Bus(servos, line=SerialLine(is_paced=True, usb_latency_ns=1_000_000))


@pytest.fixture
def port(bus):
    it = VirtualPort(bus, ManualClock())
    it.openPort()
    return it


@pytest.fixture
def ph():
    return sdk.Protocol2PacketHandler()


def test_reboot_and_clear_multi_turn(port, ph, bus):
    bus.servo(1).shaft.position = 10_000.0
    assert ph.clearMultiTurn(port, 1) == (COMM_SUCCESS, 0)
    assert ph.read4ByteTxRx(port, 1, 132)[0] == 10_000 % 4096
    assert ph.reboot(port, 1) == (COMM_SUCCESS, 0)
    assert ph.ping(port, 1)[1] == COMM_RX_TIMEOUT
    port.clock.advance(300_000_000)
    assert ph.ping(port, 1)[1] == COMM_SUCCESS


def test_replies_that_hold_a_header_are_stuffed(port, ph, bus):
    bus.servo(1).shaft.position = float(0xFDFFFF - (1 << 24))
    value, result, _ = ph.read4ByteTxRx(port, 1, 132)
    assert (value - (1 << 32), result) == (0xFDFFFF - (1 << 24), COMM_SUCCESS)


def test_two_runs_are_the_same_to_the_bit(ph):
    def run():
        bus = Bus(
            [EmulatedServo(1), EmulatedServo(2)],
            line=SerialLine(is_paced=True, usb_latency_ns=1_000_000),
        )
        port = VirtualPort(bus, ManualClock())
        port.openPort()
        return [(ph.read4ByteTxRx(port, 1, 132), port.clock.now_ns()) for _ in range(200)]

    assert run() == run()


def test_modelled_cycle_agrees_with_the_wire(port, ph):
    """At 1 Mbps three servos take 109 bytes and four turns: 1.24 ms before the adapter's delay."""
    write = sdk.GroupSyncWrite(port, ph, 116, 4)
    read = sdk.GroupSyncRead(port, ph, 126, 10)
    for servo in (1, 2, 3):
        write.addParam(servo, [0, 8, 0, 0])
        read.addParam(servo)
    spans = []
    for _ in range(200):
        before = port.clock.now_ns()
        write.txPacket()
        assert read.txRxPacket() == COMM_SUCCESS
        spans.append((port.clock.now_ns() - before) * 1e-6)
        port.clock.advance(5_000_000)
    spans.sort()
    assert spans[0] >= 1.24
    assert spans[100] == pytest.approx(1.9, abs=0.25)
    assert spans[-1] <= 2.35


def test_a_read_of_what_has_come_takes_no_time(port, ph):
    port.ser.timeout = 0.1
    port.writePort(list(bytes.fromhex("fffffd00010300 01 194e")))
    assert len(port.readPort(1)) == 1
    now = port.clock.now_ns()
    assert len(port.readPort(13)) == 13
    assert port.clock.now_ns() == now
    assert port.readPort(1) == b""
    assert port.clock.now_ns() == now + 100_000_000


def test_numbers_of_instructions_are_those_of_the_sdk():
    from dynamixel_sdk import protocol2_packet_handler as numbers

    known = {one for one in Instruction if hasattr(numbers, f"INST_{one.name}")}
    assert len(known) >= 13
    assert all(getattr(numbers, f"INST_{one.name}") == one for one in known)
