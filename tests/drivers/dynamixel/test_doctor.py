"""What the doctor finds on an emulated bus, and what it says."""

import pytest

pytest.importorskip("dynamixel_sdk")

from dynamixel_sdk import Protocol2PacketHandler

from emulated_dynamixel import (
    XL330_M288,
    Bus,
    EmulatedServo,
    FaultKind,
    ReplyFault,
    SerialLine,
    VirtualPort,
)
from orientd.clock import ManualClock
from orientd_dynamixel import doctor
from orientd_dynamixel.bus import ServoBus
from orientd_dynamixel.doctor import diagnose
from orientd_dynamixel.options import parse


@pytest.fixture
def bench():
    servos = [
        EmulatedServo(1),
        EmulatedServo(2, baud_index=1),
        EmulatedServo(7, XL330_M288),
    ]
    port = VirtualPort(Bus(servos, line=SerialLine(is_paced=True)), ManualClock())

    def open_bus(name, baud, *, wait_ms, glance_s):
        port.setBaudRate(baud)
        port.ser.timeout = glance_s
        return ServoBus(port, Protocol2PacketHandler(), wait_ms=wait_ms)

    port.open_bus = open_bus
    return port


def scan(bench):
    return doctor.scan("virtual", ids=range(10), open_bus=bench.open_bus)


def test_servos_are_found_at_every_line_speed(bench):
    found = scan(bench)
    assert [(s.id, s.name, s.baud) for s in found] == [
        (2, "XM430-W350", 57600),
        (1, "XM430-W350", 1_000_000),
        (7, "XL330-M288", 1_000_000),
    ]
    assert [s.return_delay_us for s in found] == [500, 500, 500]


@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.CORRUPT, FaultKind.DELAY])
@pytest.mark.parametrize("answer", range(3))
def test_servo_that_should_be_there_is_asked_again(bench, kind, answer):
    """Two answers in a row are lost: to pings, or to the reads that follow."""
    bench.bus.faults.add(1, ReplyFault(kind, remaining=2))
    for _ in range(answer):
        bench.bus.faults.apply(1, bytes(11))
    found = doctor.scan(
        "virtual", bauds=[1_000_000], ids=[1, 7], wanted=[1, 7], open_bus=bench.open_bus
    )
    assert [servo.id for servo in found] == [1, 7]


def test_servos_are_found_through_an_adapter_as_it_comes():
    """With a latency timer of 16 ms, which an answer may need all of."""
    port = VirtualPort(Bus([EmulatedServo(1)], line=SerialLine(is_paced=True)), ManualClock())
    port.bus.faults.add(1, ReplyFault(FaultKind.DELAY, delay_ns=16_000_000))
    options = parse({"port": "/dev/null", "latency_ms": 16.0, "order": "ZY",
                     "axes": [{"id": 1, "name": "pan"}, {"id": 2, "name": "tilt"}]})  # fmt: skip

    def open_bus(name, baud, *, wait_ms, glance_s):
        port.setBaudRate(baud)
        port.ser.timeout = glance_s
        return ServoBus(port, Protocol2PacketHandler(), wait_ms=wait_ms)

    found = {one.name: one for one in diagnose(options, 0.01, open_bus)}
    assert "XM430-W350" in found["servo 1 (pan)"].found
    assert found["servo 2"].found == "does not answer at any line speed"


def test_advice_names_what_to_change(bench):
    bench.bus.servos[0].fail(1 << 5, 0)
    advice = "\n".join(doctor.advise(scan(bench)))
    for part in (
        "servo 1 reports overload",
        "set to [57600, 1000000] baud",
        "57600 baud is slow",
        "return delay is not 0",
    ):
        assert part in advice


def test_silent_bus_is_said_to_be_silent():
    assert "no servo answers" in doctor.advise([])[0]


def test_nothing_is_said_where_nothing_is_wrong():
    good = [doctor.FoundServo(k, 1020, 48, 1_000_000, 0, 0) for k in (1, 2, 3)]
    assert doctor.advise(good) == []


def test_calculated_rates_are_those_of_the_field():
    good = [doctor.FoundServo(k, 1020, 44, 1_000_000, 0, 0) for k in (1, 2, 3)]
    assert 200 <= doctor.safe_rate_hz(good, 1_000_000) <= 350
    factory = [doctor.FoundServo(k, 1020, 44, 57600, 500, 0) for k in (1, 2, 3)]
    assert doctor.cycle_ms(factory, 57600) == pytest.approx(25, abs=3)


def test_measured_cycle_is_that_of_the_line(bench):
    servos = [s for s in scan(bench) if s.baud == 1_000_000]
    bus = bench.open_bus("virtual", 1_000_000, wait_ms=4.0, glance_s=0.002)
    got = doctor.measure_cycle_ms(bus, servos, now_ns=bench.clock.now_ns)
    # 16 bytes out, two answers of 14 bytes and a head of 8 in, two delays of 550 us
    assert got == pytest.approx(0.16 + 0.36 + 1.1, abs=0.1)


def test_ports_that_keep_their_names_come_first(tmp_path):
    (tmp_path / "serial" / "by-id").mkdir(parents=True)
    for name in ("ttyUSB0", "ttyUSB1", "ttyS0"):
        (tmp_path / name).touch()
    link = tmp_path / "serial" / "by-id" / "usb-FTDI"
    link.symlink_to(tmp_path / "ttyUSB1")
    assert doctor.find_ports(tmp_path) == [link, tmp_path / "ttyUSB0"]


def test_latency_timer_is_read_where_there_is_one(tmp_path):
    (tmp_path / "ttyUSB0").mkdir()
    (tmp_path / "ttyUSB0" / "latency_timer").write_text("16\n")
    (tmp_path / "port").symlink_to(tmp_path / "ttyUSB0")
    assert doctor.latency_timer_ms(tmp_path / "port", tmp_path) == 16
    assert doctor.latency_timer_ms(tmp_path / "other", tmp_path) is None
