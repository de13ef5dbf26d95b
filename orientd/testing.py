"""A conformance suite for drivers: what the servo relies on, as tests to inherit.

A driver package subclasses :class:`DriverConformance` in its tests and says how to make a driver
for a device that is there (an emulated one will do)::

    class TestMyDriver(DriverConformance):
        def make_driver(self):
            return MyDriver({"host": "127.0.0.1"}, period_ns=2_000_000, clock=self.clock)

Run it with pytest.  Every test opens a driver of its own and closes it.
"""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from unittest import SkipTest

from orientd.clock import Clock, MonotonicClock
from orientd.driver import Driver, Feedback, Freeable, Setpoint
from orientd.errors import DeviceError
from orientd.floats import difference, exp, multiply, norm

_FORBIDDEN = ("numpy", "scipy", "asyncio", "grpc", "pydantic", "orientd.kernels")


class DriverConformance(ABC):
    """What every driver must do.

    Attributes:
        clock: hand it to the driver.
        follow_tolerance: how near the feedback must come to a setpoint that stands still, rad.
        settle_cycles: how many cycles that may take.
    """

    clock: Clock = MonotonicClock()
    follow_tolerance: float = 1e-6
    settle_cycles: int = 100

    @abstractmethod
    def make_driver(self) -> Driver:
        """Return a driver, not yet opened, for a device that is there."""

    def break_device(self) -> bool:
        """Make the device unreachable; return whether that was possible."""
        return False

    def pass_cycle(self, driver: Driver) -> None:
        """Let one period pass.  Override to move a manual clock."""
        time.sleep(driver.period_ns * 1e-9)

    @contextlib.contextmanager
    def opened(self) -> Iterator[Driver]:
        """Open a driver, and close it on every way out."""
        driver = self.make_driver()
        try:
            driver.open()
            yield driver
        finally:
            driver.close()

    def hold(self, driver: Driver, setpoint: Setpoint, cycles: int) -> Feedback:
        """Write the same setpoint for *cycles* cycles and return the last feedback."""
        feedback = None
        for _ in range(cycles):
            feedback = driver.read() or feedback
            driver.write(setpoint)
            self.pass_cycle(driver)
        assert feedback is not None, "no feedback while holding"
        return feedback

    def setpoint(self, driver: Driver, start: Feedback, angle: float = 0.0) -> Setpoint:
        """Return a setpoint *angle* rad from *start*: about z, or of the last axis."""
        now_ns = self.clock.now_ns()
        if driver.takes == "joints":
            joints = (*start.joints[:-1], start.joints[-1] + angle)
            return Setpoint(now_ns, start.q, position=start.position, joints=joints)
        q = multiply(start.q, exp((0.0, 0.0, angle)))
        return Setpoint(now_ns, q, position=start.position)

    def gap(self, setpoint: Setpoint, feedback: Feedback) -> float:
        """Return how far the device is from a setpoint, rad."""
        if setpoint.joints:
            pairs = zip(setpoint.joints, feedback.joints, strict=True)
            return max(abs(asked - measured) for asked, measured in pairs)
        return norm(difference(setpoint.q, feedback.q))

    def test_its_class_has_a_name_and_a_rate(self) -> None:
        """The registry and the configuration need both."""
        driver = type(self.make_driver())
        assert driver.name, "name must not be empty"
        assert driver.default_rate_hz > 0, "default_rate_hz must be positive"

    def test_an_unknown_option_is_refused_by_name(self) -> None:
        """A typing error in the configuration must not pass unnoticed."""
        made = self.make_driver()
        options = {**made.options, "no_such_option": 1}
        try:
            type(made)(options, period_ns=made.period_ns, clock=self.clock)
        except ValueError as error:
            assert "no_such_option" in str(error), f"the message must name the option: {error}"
        else:
            raise AssertionError("an unknown option was accepted")

    def test_it_loads_nothing_that_the_servo_process_must_not(self) -> None:
        """A servo process is small; NumPy alone is as large again."""
        module = type(self.make_driver()).__module__
        code = f"import sys, {module}; print(*[m for m in {_FORBIDDEN!r} if m in sys.modules])"
        loaded = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
        assert not loaded, f"importing {module} loads {loaded}"

    def test_enable_says_where_the_device_is(self) -> None:
        """The first setpoint is what enable returns, so it must be an orientation."""
        with self.opened() as driver:
            feedback = driver.enable()
            length = math.sqrt(sum(part * part for part in feedback.q))
            assert abs(length - 1.0) < 1e-9, f"the quaternion's norm is {length!r}"
            assert all(math.isfinite(part) for part in feedback.position)
            assert feedback.joints or driver.takes == "poses", "it does not say where its axes are"

    def test_enabling_and_holding_does_not_move_it(self) -> None:
        """Nothing may move before a motion is started."""
        with self.opened() as driver:
            start = driver.enable()
            setpoint = self.setpoint(driver, start)
            feedback = self.hold(driver, setpoint, self.settle_cycles)
            moved = self.gap(setpoint, feedback)
            assert moved <= self.follow_tolerance, f"it moved by {moved:.3g} rad"

    def test_it_follows_a_slow_turn(self) -> None:
        """A turn of 0.02 rad at 0.2 rad/s arrives."""
        with self.opened() as driver:
            start = driver.enable()
            period = driver.period_ns * 1e-9
            cycles = max(2, round(0.1 / period))
            omega = (0.0, 0.0, 0.02 / (cycles * period))
            for k in range(1, cycles + 1):
                driver.read()
                setpoint = self.setpoint(driver, start, 0.02 * k / cycles)
                driver.write(setpoint._replace(omega_body=omega))
                self.pass_cycle(driver)
            resting = self.setpoint(driver, start, 0.02)
            feedback = self.hold(driver, resting, self.settle_cycles)
            gap = self.gap(resting, feedback)
            assert gap <= self.follow_tolerance, f"it stands {gap:.3g} rad from the setpoint"

    def test_feedback_is_stamped_when_it_was_measured(self) -> None:
        """Ages are computed from the stamps: never from the future, never backwards."""
        with self.opened() as driver:
            start = driver.enable()
            setpoint = self.setpoint(driver, start)
            last = 0
            for _ in range(self.settle_cycles):
                feedback = driver.read()
                if feedback is not None:
                    assert feedback.time_ns <= self.clock.now_ns(), "feedback from the future"
                    assert feedback.time_ns >= last, "feedback went back in time"
                    last = feedback.time_ns
                driver.write(setpoint)
                self.pass_cycle(driver)
            assert last > start.time_ns, "feedback never changed"

    def test_its_outline_is_made_of_lines(self) -> None:
        """What is drawn of a device has two points a line at the least, all of them somewhere."""
        with self.opened() as driver:
            joints = driver.enable().joints
        for line in self.make_driver().outline(joints):
            assert len(line) >= 2, f"a line of {len(line)} points"
            assert all(len(point) == 3 and all(map(math.isfinite, point)) for point in line)

    def test_it_can_be_disabled_and_enabled_again(self) -> None:
        """Disabling is idempotent and not the end."""
        with self.opened() as driver:
            driver.enable()
            driver.disable()
            driver.disable()
            again = driver.enable()
            self.hold(driver, self.setpoint(driver, again), 3)

    def test_it_can_be_let_go_and_enabled_again(self) -> None:
        """Where it can be moved by hand it goes on saying where it is; where not, it says so."""
        with self.opened() as driver:
            driver.enable()
            driver.disable()
            if not isinstance(driver, Freeable):
                raise SkipTest("it cannot be moved by hand")
            driver.free()
            for _ in range(self.settle_cycles):
                self.pass_cycle(driver)
                feedback = driver.read()
            assert feedback is not None, "it does not say where it is"
            again = driver.enable()
            self.hold(driver, self.setpoint(driver, again), 3)

    def test_it_can_be_closed_twice_and_unopened(self) -> None:
        """Every way out of the servo process ends in close."""
        driver = self.make_driver()
        driver.close()
        with self.opened() as driver:
            driver.close()

    def test_an_unreachable_device_is_a_device_error(self) -> None:
        """The servo turns DeviceErrors into faults; anything else is a defect."""
        with self.opened() as driver:
            start = driver.enable()
            if not self.break_device():
                return
            try:
                self.hold(driver, self.setpoint(driver, start), 10 * self.settle_cycles)
            except DeviceError:
                return
            raise AssertionError("nothing was raised after the device had gone")
