"""The doctor's checks of an emulated bus, and its messages."""

from dataclasses import replace

import pytest

pytest.importorskip("dynamixel_sdk")

from dynamixel_sdk import Protocol2PacketHandler

from emulated_dynamixel import (
    XL330_M288,
    Bus,
    EmulatedServo,
    FaultKind,
    ManualClock,
    ReplyFault,
    SerialLine,
    VirtualPort,
)
from orientd.driver import Verdict
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
    assert [(s.id, s.kind.name, s.baud) for s in found] == [
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


def findings(bench, ids, **options):
    """Return the findings on a bus of servos named a, b, ... by the name of what was found."""
    axes = [{"id": k, "name": name} for k, name in zip(ids, "ab", strict=False)]
    settings = {"port": "/dev/null", "order": "ZY", "overwrite": True, "axes": axes, **options}
    return {one.name: one for one in diagnose(parse(settings), 0.01, bench.open_bus)}


def test_servo_that_is_as_it_should_be_is_all_right(bench):
    bench.bus.servos[1:] = [EmulatedServo(2)]
    found = findings(bench, (1, 2))
    assert {found[name].verdict for name in found} == {Verdict.OK}
    assert "configured are 100 Hz" in found["rate"].found
    assert (
        found["servo 1 (a)"].found == "XM430-W350, firmware 48, 1000000 baud, return delay 500 us"
    )


def set_firmware(servo):
    servo._memory[6] = 44


@pytest.mark.parametrize(
    ("change", "name", "verdict", "words"),
    [
        (lambda one: one.fail(1 << 5, 0), "servo 1 (a)", "problem", "a reset starts it again"),
        (set_firmware, "servo 1 (a)", "improve", "knows no fast reads"),
        (lambda one: one.write(20, b"\1\0\0\0", 0), "servo 1 (a)", "problem", "homing_offset"),
        (lambda one: one.disconnect(0), "servo 1", "problem", "look at cable"),
        (lambda one: None, "servo 2 (b)", "problem", "configured are 1000000 baud"),
    ],
)
def test_servo_is_found_with_what_to_do_about_it(bench, change, name, verdict, words):
    change(bench.bus.servos[0])
    found = findings(bench, (1, 2), overwrite=["operating_mode"])[name]
    assert found.verdict is Verdict(verdict)
    assert words in found.mend


def test_other_model_and_unknown_model_are_named(bench):
    other = findings(bench, (1, 7))["servo 7 (b)"]
    assert (other.verdict, other.mend) == (Verdict.PROBLEM, "configured is XM430-W350")
    bench.bus.servos[2]._memory[:2] = (9999).to_bytes(2, "little")
    bench.bus.servos[2].model = replace(XL330_M288, number=9999)
    assert "model 9999, which is not known" in findings(bench, (1, 7))["servo 7 (b)"].found


def test_slow_line_is_found(bench):
    bench.bus.servos[:] = [EmulatedServo(k, baud_index=1) for k in (1, 2)]
    found = findings(bench, (1, 2), baud=57_600)
    assert "1000000 baud is quicker" in found["servo 1 (a)"].mend
    assert found["rate"].verdict is Verdict.IMPROVE
    assert "set rate_hz to 3" in found["rate"].mend


def test_servo_that_is_not_configured_is_said_to_be_there(bench):
    bench.bus.servos[1] = EmulatedServo(2)
    assert "XL330-M288" in findings(bench, (1, 2))["servo 7"].found
    assert findings(bench, (1, 2))["servo 7"].found.endswith("not configured")


def test_calculated_cycles_are_those_of_the_field():
    good = [doctor.FoundServo(k, 1020, 44, 1_000_000) for k in (1, 2, 3)]
    assert 350 >= 570 / doctor.cycle_ms(good, 1_000_000) >= 200
    assert doctor.cycle_ms(good, 57_600) == pytest.approx(24, abs=3)


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
