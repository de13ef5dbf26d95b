"""The driver over the real SDK, pyserial and a pseudo-terminal, the emulator in its own process."""

import contextlib
import math
import os
import time

import harness
import pytest
from gimbal_bench import EmulatedGimbal
from harness import until

pytest.importorskip("dynamixel_sdk")

from orientd.clock import MonotonicClock
from orientd.driver import (
    Arriving,
    Diagnosable,
    Freeable,
    Healthy,
    Parkable,
    Resettable,
    RestsInFault,
    Setpoint,
)
from orientd.errors import DeviceError, LinkError
from orientd.floats import difference, norm
from orientd.mechanism import Mechanical
from orientd.testing import DriverConformance
from orientd_dynamixel import DynamixelDriver
from orientd_dynamixel.bus import open_bus
from orientd_dynamixel.tables import X430

pytestmark = pytest.mark.world

PERIOD_NS = 10_000_000


@pytest.fixture
def emulator(tmp_path):
    it = EmulatedGimbal(tmp_path / "bus")
    yield it
    it.end()


# Without real-time priority the processes of driver and emulator may wait long for a processor.
PATIENT = {"max_losses": 50, "latency_ms": 100.0, "watchdog_ms": 2500}


def make(link, **options):
    axes = [{"id": k, "limits_deg": [-170, 170]} for k in (1, 2, 3)]
    return DynamixelDriver(
        {"port": str(link), "axes": axes, "overwrite": ["operating_mode"],
         **(PATIENT if harness.MACHINE.is_patient else {}), **options},
        period_ns=PERIOD_NS, clock=MonotonicClock(),
    )  # fmt: skip


class TestConformance(DriverConformance):
    """What the servo relies on."""

    # Three ticks, and the lag of a servo that a real one has too.
    follow_tolerance = 0.005
    settle_cycles = 60
    protocols = (
        Arriving,
        Diagnosable,
        Freeable,
        Healthy,
        Mechanical,
        Parkable,
        Resettable,
        RestsInFault,
    )

    @pytest.fixture(autouse=True)
    def _emulate(self, emulator):
        self.emulator = emulator

    def make_driver(self):
        return make(self.emulator.link)

    def break_device(self):
        self.emulator.tell("unplug")
        return True

    def mend_device(self):
        self.emulator.tell("plug")
        return True


def stream(driver, start, count, *, first=0):
    """Send a slow sway, on time; return the last feedback."""
    feedback = None
    due = time.monotonic_ns()
    for k in range(first, first + count):
        due += PERIOD_NS
        time.sleep(max(0.0, (due - time.monotonic_ns()) * 1e-9))
        feedback = driver.read() or feedback
        half = 0.1 * (1 - math.cos(0.02 * k))
        q = (math.cos(half), 0.0, 0.0, math.sin(half))
        joints = (2.0 * half, *start.joints[1:])
        driver.write(Setpoint(due, q, joints=joints))
    return feedback, q, joints


def test_gimbal_follows_over_the_real_stack(emulator):
    with contextlib.closing(make(emulator.link)) as driver:
        driver.open()
        start = driver.enable()
        _, q, joints = stream(driver, start, 200)
        settled_ns = time.monotonic_ns() + 30 * PERIOD_NS

        def settled():
            time.sleep(PERIOD_NS * 1e-9)
            feedback = driver.read()
            driver.write(Setpoint(0, q, joints=joints))
            return feedback if feedback.time_ns > settled_ns else None

        feedback = until(settled, "a measurement of the resting gimbal")
        assert norm(difference(q, feedback.q)) < 0.003


def test_unplugged_adapter_is_a_link_error_and_reset_finds_it_again(emulator):
    with contextlib.closing(make(emulator.link)) as driver:
        driver.open()
        start = driver.enable()
        stream(driver, start, 20)
        emulator.tell("unplug")
        with pytest.raises(LinkError):
            stream(driver, start, 50, first=20)
        with pytest.raises(DeviceError):
            driver.disable()
        with pytest.raises(LinkError, match="cannot open"):
            driver.reset()
        emulator.tell("plug")
        driver.reset()
        assert norm(difference(driver.enable().q, start.q)) < 0.1


def test_port_is_ours_alone(emulator):
    with contextlib.closing(make(emulator.link)) as driver:
        driver.open()
        other = make(emulator.link)
        with pytest.raises(LinkError, match=r"cannot open .*; end the program that uses it"):
            other.open()


def test_missing_port_is_a_link_error_that_names_it(tmp_path):
    with pytest.raises(LinkError) as caught:
        make(tmp_path / "nothing").open()
    assert str(caught.value) == (
        f"cannot open {tmp_path}/nothing: No such file or directory; "
        "plug in the adapter, or correct `port`"
    )


@pytest.mark.real
def test_a_write_does_not_wait_for_a_device_that_takes_nothing():
    device, port = os.openpty()
    bus = open_bus(os.ttyname(port), 57_600)

    def fill():
        for _ in range(10_000):
            bus.sync_write([(1, X430.table.goal, 2048), (2, X430.table.goal, 2048)])

    try:
        with pytest.raises(LinkError, match="a write of goals was not sent"):
            fill()
    finally:
        bus.close()
        os.close(device)
        os.close(port)
