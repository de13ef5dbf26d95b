"""The bus behind a pseudo-terminal, with the vendor's SDK, a second client, and signals."""

import os
import random
import signal
import subprocess
import sys
import threading
import time

import pytest

from emulated_dynamixel import Bus, EmulatedServo, PtyServer, servos

sdk = pytest.importorskip("dynamixel_sdk")


@pytest.fixture
def link(tmp_path):
    now = time.monotonic_ns()
    bus = Bus(
        [EmulatedServo(i, now_ns=now) for i in (1, 2, 3)], rng=random.Random(1), gap_ns=20_000_000
    )
    server = PtyServer(bus, tmp_path / "bus")
    server.plug()
    read, write = os.pipe()

    def serve():
        while not server.step(read):
            pass

    thread = threading.Thread(target=serve)
    thread.start()
    yield server
    os.write(write, b"x")
    thread.join()
    server.unplug()
    os.close(read)
    os.close(write)


@pytest.fixture
def port(link, monkeypatch):
    # The vendor allows 34 ms for an answer, but a busy machine may not run the bus for longer.
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 5000)
    it = sdk.PortHandler(str(link.link))
    assert it.openPort()
    it.ser.timeout = 0.002
    yield it
    it.closePort()


def test_unmodified_sdk_drives_the_bus(port):
    ph = sdk.Protocol2PacketHandler()
    for servo in (1, 2, 3):
        assert ph.ping(port, servo) == (1020, 0, 0)
        assert ph.write1ByteTxRx(port, servo, 11, 4) == (0, 0)
        assert ph.write1ByteTxRx(port, servo, 64, 1) == (0, 0)
    write = sdk.GroupSyncWrite(port, ph, 116, 4)
    read = sdk.GroupSyncRead(port, ph, 116, 4)
    for servo in (1, 2, 3):
        write.addParam(servo, list((100 * servo).to_bytes(4, "little")))
        read.addParam(servo)
    assert write.txPacket() == 0
    for kind in (read.txRxPacket, read.fastSyncRead):
        assert kind() == 0
        assert [read.getData(servo, 116, 4) for servo in (1, 2, 3)] == [100, 200, 300]


def test_servos_at_another_line_speed_are_silent(port, monkeypatch):
    ph = sdk.Protocol2PacketHandler()
    with monkeypatch.context() as quick:
        quick.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 4)
        assert port.setBaudRate(57600)
        assert ph.ping(port, 1)[1] == -3001
    assert port.setBaudRate(1_000_000)
    assert ph.ping(port, 1)[1] == 0


@pytest.mark.parametrize("fast", [False, True])
def test_rustypot_reads_and_writes_positions(link, fast):
    rustypot = pytest.importorskip("rustypot")
    bus = rustypot.Xl430PyController(str(link.link), 1_000_000, 2.0)
    try:
        bus.set_fast_sync_read(fast)
        assert bus.scan([1, 2, 3, 4]) == {1: 1020, 2: 1020, 3: 1020}
        bus.sync_write_operating_mode([1, 2, 3], [4, 4, 4])
        bus.sync_write_torque_enable([1, 2], [True, True])
        goals = [1000, 3000]
        bus.sync_write_goal_position([1, 2], goals)
        assert bus.sync_read_goal_position([1, 2]) == goals
        link.bus.servo(3).shaft.position = -131073.0  # FF FF FD FF on the wire
        assert bus.sync_read_raw_data([3], 132, 4) == [b"\xff\xff\xfd\xff"]
        link.bus.servo(1).fail(4, 0)
        assert bus.read_raw_data_with_error(1, 70, 1) == ([4], 0x80)
        assert bus.reboot(1)
    finally:
        bus.close()


def test_unplugging_takes_the_link_away_and_plugging_in_brings_it_back(tmp_path):
    server = PtyServer(Bus([EmulatedServo(1)]), tmp_path / "bus")
    server.plug()
    first = server.link.readlink()
    assert first.exists()
    server.unplug()
    assert not server.link.is_symlink()
    server.plug()
    assert server.link.is_symlink()
    server.unplug()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_process_says_ready_and_ends_cleanly_without_its_link(tmp_path, number):
    place = tmp_path / "bus"
    process = subprocess.Popen(
        [sys.executable, "-m", "orientd", "sim", "dynamixel", "--link", str(place), "--console"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        assert process.stdout.readline().startswith("ready")
        assert place.is_symlink()
        for command, answer in (
            ("drop 1 0.5 3", "done"),
            ("delay 2 20 0.1", "done"),
            ("jam 3", "done"),
            ("error 3 0x20", "done"),
            ("disconnect 2", "done"),
            ("clear", "done"),
            ("jam 9", "refused"),
            ("sing", "refused"),
        ):
            process.stdin.write(command + "\n")
            process.stdin.flush()
            assert process.stdout.readline().startswith(answer)
        os.kill(process.pid, number)
        assert process.wait(10) == 0
        assert process.stderr.read() == ""
    assert not place.is_symlink()


@pytest.mark.parametrize("text", ["1:xm999", "300", "1,1", "\N{SUPERSCRIPT TWO}", ""])
def test_impossible_servos_are_refused(text):
    with pytest.raises(ValueError, match="servos must"):
        servos(text)
