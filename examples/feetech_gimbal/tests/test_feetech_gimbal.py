"""The driver keeps what every driver promises, on emulated servos."""

import math
import time

import pytest
from emulated_servos import EmulatedServos
from feetech_gimbal.driver import FeetechGimbal
from feetech_gimbal.packets import Answers, Status, goals, packet

from orientd.driver import Arriving, Freeable, Healthy, Parkable, Resettable, Setpoint
from orientd.errors import AxisFaultError
from orientd.mechanism import Mechanical
from orientd.testing import DriverConformance

PERIOD_NS = 10_000_000
AXES = [{"id": k, "name": name} for k, name in ((1, "yaw"), (2, "pitch"), (3, "roll"))]


@pytest.fixture
def servos(tmp_path):
    """A bus that is plugged in."""
    it = EmulatedServos(tmp_path / "bus")
    yield it
    if it.is_plugged:
        it.unplug()


class TestFeetechGimbal(DriverConformance):
    """What the servo relies on."""

    # Two ticks of 4096 a turn.
    follow_tolerance = 0.003
    settle_cycles = 40
    protocols = (Arriving, Freeable, Healthy, Mechanical, Parkable, Resettable)

    @pytest.fixture(autouse=True)
    def _servos(self, servos):
        self.servos = servos

    def make_driver(self):
        """Return a driver of three axes."""
        options = {"port": str(self.servos.link), "axes": AXES}
        return FeetechGimbal(options, period_ns=PERIOD_NS, clock=self.clock)

    def break_device(self):
        """Pull the adapter out."""
        self.servos.unplug()
        return True

    def mend_device(self):
        """Plug it in again; a reset opens the port anew."""
        self.servos.plug()
        return True

    def test_an_overload_names_the_servo(self):
        """An axis that fails lets the others brake on the path."""
        with self.opened() as driver:
            start = driver.enable()
            self.servos.servos[2].error = 0b100000
            with pytest.raises(AxisFaultError, match="servo 2: overload"):
                self.hold(driver, self.setpoint(driver, start, 0.0), 10)

    def test_a_goal_is_sent_to_the_nearest_tick(self):
        """A right angle is 1024 ticks, and half a tick is not lost."""
        with self.opened() as driver:
            driver.enable()
            tick = math.tau / 4096
            driver.write(Setpoint(0, (1.0, 0.0, 0.0, 0.0), joints=(math.pi / 2, -1.6 * tick, 0.0)))
            time.sleep(0.05)
            assert [one.goal for one in self.servos.servos.values()] == [3072, 2046, 2048]


def test_packets_are_those_of_the_manual():
    """Examples of the vendor's manual: ping, and goal 0 and 2048 for servos 1 and 2."""
    assert packet(1, 0x01).hex() == "ffff010201fb"
    assert goals({1: 0, 2: 2048}).hex() == "fffffe0a832a020100000200083d"


@pytest.mark.parametrize("size", [1, 2, 3, 7, 100])
def test_answers_are_found_however_they_arrive(size):
    """In pieces, after noise, behind a damaged one."""
    good = bytes.fromhex("ffff0104001805dd")
    line = b"\x00\xff" + good + bytes.fromhex("ffff0104001805de") + good
    answers, found = Answers(), []
    for at in range(0, len(line), size):
        found += answers.take(line[at : at + size])
    assert found == [Status(1, 0, b"\x18\x05")] * 2
