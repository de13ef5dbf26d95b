"""The vendor's SDK as motor buses of robot-learning libraries use it, in virtual time.

They ping every motor, write registers with retries, calibrate by homing offsets, and then read and
write all positions at once, many times over.
"""

import pytest

sdk = pytest.importorskip("dynamixel_sdk")

from emulated_dynamixel import (  # noqa: E402
    MODELS,
    Bus,
    EmulatedServo,
    ManualClock,
    SerialLine,
    VirtualPort,
)

MOTORS = {1: "xl330-m077", 2: "xl330", 3: "xl430-w250", 4: "xm430", 5: "xm540-w270"}
RETURN_DELAY, DRIVE_MODE, OPERATING_MODE, HOMING_OFFSET = (9, 1), (10, 1), (11, 1), (20, 4)
MAX_POSITION, MIN_POSITION, TORQUE, P_GAIN = (48, 4), (52, 4), (64, 1), (84, 2)
GOAL_POSITION, PRESENT_POSITION = (116, 4), (132, 4)
EXTENDED, HALF_TURN = 4, 2047


class MotorsBus:
    def __init__(self, port):
        self.port = port
        self.packets = sdk.PacketHandler(2.0)
        self.reader = sdk.GroupSyncRead(port, self.packets, 0, 0)
        self.writer = sdk.GroupSyncWrite(port, self.packets, 0, 0)

    def read(self, motor, register):
        address, size = register
        read = {1: self.packets.read1ByteTxRx, 2: self.packets.read2ByteTxRx}.get(
            size, self.packets.read4ByteTxRx
        )
        value, result, error = read(self.port, motor, address)
        assert (result, error) == (0, 0)
        return value

    def write(self, motor, register, value):
        address, size = register
        raw = list((value & (1 << 8 * size) - 1).to_bytes(size, "little"))
        assert self.packets.writeTxRx(self.port, motor, address, size, raw) == (0, 0)

    def sync_read(self, register):
        self.reader.clearParam()
        self.reader.start_address, self.reader.data_length = register
        for motor in MOTORS:
            assert self.reader.addParam(motor)
        assert self.reader.txRxPacket() == 0
        assert all(self.reader.isAvailable(motor, *register) for motor in MOTORS)
        found = {motor: self.reader.getData(motor, *register) for motor in MOTORS}
        return {motor: (one ^ 1 << 31) - (1 << 31) for motor, one in found.items()}

    def sync_write(self, register, values):
        self.writer.clearParam()
        self.writer.start_address, self.writer.data_length = address, size = register
        assert address
        for motor, value in values.items():
            assert self.writer.addParam(motor, list((value & 0xFFFFFFFF).to_bytes(size, "little")))
        assert self.writer.txPacket() == 0


@pytest.fixture
def bus():
    servos = [EmulatedServo(motor, MODELS[name]) for motor, name in MOTORS.items()]
    line = SerialLine(is_paced=True, usb_latency_ns=1_000_000)
    port = VirtualPort(Bus(servos, line=line), ManualClock(), latency_ms=16.0)
    assert port.openPort()
    assert port.setBaudRate(1_000_000)
    return MotorsBus(port)


def test_every_motor_answers_with_its_model(bus):
    for motor, name in MOTORS.items():
        assert bus.packets.ping(bus.port, motor) == (MODELS[name].number, 0, 0)
    found, result = bus.packets.broadcastPing(bus.port)
    assert result == 0
    assert {motor: one[0] for motor, one in found.items()} == {
        motor: MODELS[name].number for motor, name in MOTORS.items()
    }


def test_motors_are_calibrated_and_follow_positions(bus):
    for motor in MOTORS:
        bus.write(motor, TORQUE, 0)
        bus.write(motor, RETURN_DELAY, 0)
        bus.write(motor, OPERATING_MODE, EXTENDED)
        bus.write(motor, HOMING_OFFSET, 0)
        bus.write(motor, DRIVE_MODE, 0)
    for motor, position in bus.sync_read(PRESENT_POSITION).items():
        bus.write(motor, HOMING_OFFSET, HALF_TURN - position)
        bus.write(motor, MIN_POSITION, 100)
        bus.write(motor, MAX_POSITION, 4000)
    assert bus.sync_read(PRESENT_POSITION) == dict.fromkeys(MOTORS, HALF_TURN)
    for motor in MOTORS:
        bus.write(motor, P_GAIN, 640)
        bus.write(motor, TORQUE, 1)
        assert bus.read(motor, P_GAIN) == 640
    goals = {motor: 1000 * (-1) ** motor + motor for motor in MOTORS}
    for _ in range(800):
        bus.sync_write(GOAL_POSITION, goals)
        found = bus.sync_read(PRESENT_POSITION)
    assert found == goals
    for motor in MOTORS:
        bus.write(motor, TORQUE, 0)


def test_a_register_that_is_locked_is_refused_and_a_missing_motor_times_out(bus):
    bus.write(1, TORQUE, 1)
    assert bus.packets.write1ByteTxRx(bus.port, 1, OPERATING_MODE[0], EXTENDED) == (0, 7)
    assert bus.packets.ping(bus.port, 9)[1] == sdk.COMM_RX_TIMEOUT
