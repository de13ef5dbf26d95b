"""The server of the bus at a terminal, on a clock that the test moves."""

import os
import termios

import pytest

from emulated_dynamixel import Bus, EmulatedServo, PtyServer
from emulated_dynamixel.packet import BROADCAST, Instruction, Packet, encode

CYCLE_NS = 10_000_000


def test_servos_follow_a_late_server_as_if_it_had_been_on_time(tmp_path):
    now_ns = 0
    servo = EmulatedServo(1)
    for address, value in ((11, 4), (64, 1), (98, 5)):  # mode, torque, a watchdog of 100 ms
        servo.write(address, bytes([value]), 0)
    server = PtyServer(Bus([servo]), tmp_path / "port", now_ns=lambda: now_ns)
    server.plug()
    port = os.open(tmp_path / "port", os.O_RDWR | os.O_NOCTTY)
    mode = termios.tcgetattr(port)
    mode[4:6] = termios.B1000000, termios.B1000000
    termios.tcsetattr(port, termios.TCSANOW, mode)
    lags, goal = [], 2048
    try:
        for cycles_between_steps in (1, 30):
            for _ in range(30 // cycles_between_steps):
                for _ in range(cycles_between_steps):
                    now_ns += CYCLE_NS
                    goal += 10
                    content = b"\x74\0\4\0\1" + goal.to_bytes(4, "little")
                    os.write(port, encode(Packet(BROADCAST, Instruction.SYNC_WRITE, content)))
                server.step()
            lags.append(goal - servo.shaft.position)
    finally:
        os.close(port)
        server.unplug()
    assert lags[1] == pytest.approx(lags[0], abs=1.0)
    assert servo.value("bus watchdog") == 5
