"""The server of the bus at a terminal, on a clock that the test moves."""

import fcntl
import os
import termios
import time
from array import array

import pytest

from emulated_dynamixel import Bus, EmulatedServo, PtyServer
from emulated_dynamixel.packet import BROADCAST, Instruction, Packet, encode

CYCLE_NS = 10_000_000


def await_octets(master, count):
    """Wait until the kernel has passed on what was written to a terminal."""
    waiting, ends = array("i", [0]), time.monotonic() + 30.0
    while waiting[0] < count:
        assert time.monotonic() < ends
        fcntl.ioctl(master, termios.FIONREAD, waiting)


def test_servos_follow_a_late_server_as_if_it_had_been_on_time(tmp_path, monkeypatch):
    now_ns, pairs, open_pair = 0, [], os.openpty
    monkeypatch.setattr(os, "openpty", lambda: pairs.append(open_pair()) or pairs[-1])
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
                count = 0
                for _ in range(cycles_between_steps):
                    now_ns += CYCLE_NS
                    goal += 10
                    content = b"\x74\0\4\0\1" + goal.to_bytes(4, "little")
                    packet = encode(Packet(BROADCAST, Instruction.SYNC_WRITE, content))
                    count += os.write(port, packet)
                await_octets(pairs[0][0], count)
                server.step()
            lags.append(goal - servo.shaft.position)
    finally:
        os.close(port)
        server.unplug()
    assert lags[1] == pytest.approx(lags[0], abs=1.0)
    assert servo.value("bus watchdog") == 5
