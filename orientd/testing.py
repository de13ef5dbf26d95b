"""A conformance suite for drivers: what the servo relies on, as tests to inherit.

A driver package subclasses :class:`DriverConformance` in its tests and says how to make a driver
for a device that is there (an emulated one will do)::

    class TestMyDriver(DriverConformance):
        def make_driver(self):
            return MyDriver({"host": "127.0.0.1"}, period_ns=2_000_000, clock=self.clock)

Run it with pytest.  Every test opens a driver of its own and closes it.  A test of an optional
protocol that the driver does not offer is skipped, as is one that would have to break the device.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import SkipTest

from orientd import driver as offered
from orientd.clock import Clock, MonotonicClock
from orientd.driver import (
    Arriving,
    Diagnosable,
    Driver,
    Explaining,
    Feedback,
    Finding,
    Freeable,
    Healthy,
    Joints,
    Locatable,
    Parkable,
    PhaseLocked,
    Quaternion,
    Resettable,
    RestsInFault,
    Scaled,
    Setpoint,
    Tunable,
    Verdict,
    feedback_problem,
)
from orientd.errors import DeviceError, PlanError
from orientd.floats import difference, exp, multiply, norm
from orientd.mechanism.mechanism import Mechanical

_FORBIDDEN = ("numpy", "scipy", "asyncio", "grpc", "pydantic", "orientd.kernels")
_PROTOCOLS = (
    *(one for one in vars(offered).values() if getattr(one, "_is_protocol", False)),
    Mechanical,
)
_LONGEST_PARK = 20.0
_TURN = 0.02
"""rad, in 0.1 s."""


def _processor_delay() -> float:
    """Return how long this thread has been ready to run but not running, s.

    It is 0 if the kernel does not count it.
    """
    try:
        return int(Path("/proc/thread-self/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError):
        return 0.0


class DriverConformance(ABC):
    """Tests of the driver contract, to inherit.

    Attributes:
        clock: hand it to the driver.
        follow_tolerance: how near the feedback must come to a setpoint that stands still, rad.
        settle_cycles: how many cycles that may take.
        protocols: those that the driver should offer; without it, a misspelt method goes unnoticed.
    """

    clock: Clock = MonotonicClock()
    follow_tolerance: float = 1e-6
    settle_cycles: int = 100
    protocols: tuple[type, ...] = ()

    @abstractmethod
    def make_driver(self) -> Driver:
        """Return a driver, not yet opened, for a device that is there."""

    def break_device(self) -> bool:
        """Make the device unreachable; return whether that was possible."""
        return False

    def mend_device(self) -> bool:
        """Make it reachable again; return whether a reset is enough then."""
        return False

    def pass_cycle(self, driver: Driver) -> None:
        """Let one period pass.  Override to move a manual clock."""
        time.sleep(driver.period_ns * 1e-9)

    # What tests are made of

    @contextlib.contextmanager
    def opened(self) -> Iterator[Driver]:
        """Open a driver, and close it on every way out."""
        driver = self.make_driver()
        try:
            driver.open()
            yield driver
        finally:
            driver.close()

    def offering(self, driver: Driver, protocol: type) -> Any:  # noqa: ANN401 - of that protocol
        """Return *driver* if it offers *protocol*, else skip the test."""
        if not isinstance(driver, protocol):
            raise SkipTest(f"{type(driver).__name__} is not {protocol.__name__}")
        return driver

    def setpoint(
        self, driver: Driver, start: Feedback, angle: float, rate: float = 0.0
    ) -> Setpoint:
        """Return the setpoint that is turned by *angle* from *start*, at a rate."""
        q = multiply(start.q, exp((0.0, 0.0, angle)))
        joints: Joints = ()
        if driver.takes == "joints":
            assert isinstance(driver, Mechanical), "it takes joints and has no mechanism"
            mechanism = driver.mechanism(may_ask=True)
            assert mechanism is not None, "it takes joints and has no mechanism"
            joints = mechanism.nearest(q, start.position, start.joints) or ()
            assert joints, "its mechanism has no joints for a pose close by"
        now_ns, omega = self.clock.now_ns(), (0.0, 0.0, rate)
        return Setpoint(now_ns, q, omega, position=start.position, joints=joints)

    def cycle(self, driver: Driver, setpoint: Setpoint | None) -> Feedback | None:
        """Do what the servo does in a cycle; without a setpoint the driver is not enabled."""
        feedback = driver.read()
        if setpoint is not None:
            driver.write(setpoint)
        self.pass_cycle(driver)
        return feedback

    def hold(self, driver: Driver, setpoint: Setpoint | None, cycles: int) -> Feedback:
        """Let *cycles* pass with the same setpoint and return the last feedback."""
        feedback = None
        for _ in range(cycles):
            feedback = self.cycle(driver, setpoint) or feedback
        assert feedback is not None, "no feedback while holding"
        return feedback

    def turn(self, driver: Driver, start: Feedback) -> Setpoint:
        """Turn slowly; return the setpoint at the end, which stands still."""
        cycles = max(2, round(0.1 / (driver.period_ns * 1e-9)))
        rate = _TURN / (cycles * driver.period_ns * 1e-9)
        for k in range(1, cycles + 1):
            self.cycle(driver, self.setpoint(driver, start, _TURN * k / cycles, rate))
        return self.setpoint(driver, start, _TURN)

    def assert_near(self, q: Quaternion, other: Quaternion, what: str) -> None:
        """Compare two orientations within the tolerance of following."""
        gap = norm(difference(q, other))
        assert gap <= self.follow_tolerance, f"{what} by {gap:.3g} rad"

    def seconds(self, call: Callable[..., object], *arguments: object) -> float:
        """Return how long a call takes, s, by a clock that a test moves or by the real one.

        Time in which the call was ready to run, but other programs had the processor, does not
        count.
        """
        begun, begun_ns, delay = time.perf_counter(), self.clock.now_ns(), _processor_delay()
        call(*arguments)
        taken = time.perf_counter() - begun - (_processor_delay() - delay)
        if isinstance(self.clock, MonotonicClock):
            return taken
        return max(taken, (self.clock.now_ns() - begun_ns) * 1e-9)

    def assert_quick(self, driver: Driver, call: Callable[[], object]) -> None:
        """Assert that what is called in a cycle takes less than a period, once in three tries."""
        least = min(self.seconds(call) for _ in range(3))
        assert least < driver.period_ns * 1e-9, f"it took {least:.3g} s, longer than a period"

    # Class and options

    def test_its_class_has_a_name_and_a_rate(self) -> None:
        """The registry and the configuration need both."""
        driver = type(self.make_driver())
        assert driver.name, "name must not be empty"
        assert driver.default_rate_hz > 0, "default_rate_hz must be positive"

    def test_it_offers_what_it_is_meant_to(self) -> None:
        """A protocol with a missing or misspelt method is silently not offered."""
        driver = self.make_driver()
        assert driver.longest_call > 0, f"longest_call must be positive: {driver.longest_call}"
        for one in self.protocols:
            assert isinstance(driver, one), f"it is not {one.__name__}"
        for one in _PROTOCOLS:
            names = [name for name in vars(one) if not name.startswith("_")]
            missing = [name for name in names if not hasattr(driver, name)]
            assert len(missing) in (0, len(names)), f"{one.__name__} lacks {', '.join(missing)}"

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
        found_by = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        loaded = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=found_by
        ).stdout.split()
        assert not loaded, f"importing {module} loads {loaded}"

    # The six methods

    def test_enabling_and_holding_does_not_move_it(self) -> None:
        """Nothing may move before a motion is started, whatever was done before."""
        with self.opened() as driver:
            start = driver.enable()
            feedback = self.hold(driver, self.setpoint(driver, start, 0.0), self.settle_cycles)
            self.assert_near(start.q, feedback.q, "it moved")
            self.turn(driver, start)
            before = self.hold(driver, self.setpoint(driver, start, _TURN), self.settle_cycles)
            driver.disable()
            self.assert_near(driver.enable().q, before.q, "enabling it again moved it")

    def test_feedback_is_a_pose(self) -> None:
        """Before enable, at rest and in motion: types and lengths, finite, a unit quaternion."""
        with self.opened() as driver:
            reports = [self.cycle(driver, None) for _ in range(10)]
            start = driver.enable()
            reports += [start, self.cycle(driver, self.setpoint(driver, start, 0.0))]
            resting = self.turn(driver, start)
            reports += [self.cycle(driver, resting) for _ in range(self.settle_cycles)]
        for one in reports:
            if one is None:
                continue
            problem = feedback_problem(one, self.clock.now_ns())
            assert not problem, f"malformed feedback: {problem}"
            assert abs(math.hypot(*one.q) - 1.0) < 1e-9, f"the norm of {one.q} is not 1"
            assert len(one.joints) == len(start.joints), f"joints: {one.joints}"

    def test_feedback_is_stamped_when_it_was_measured(self) -> None:
        """Ages are computed from the stamps: never from the future, never backwards."""
        with self.opened() as driver:
            start = driver.enable()
            last = 0
            for _ in range(self.settle_cycles):
                feedback = driver.read()
                if feedback is not None:
                    assert feedback.time_ns <= self.clock.now_ns(), "feedback from the future"
                    assert feedback.time_ns >= last, "feedback went back in time"
                    last = feedback.time_ns
                driver.write(self.setpoint(driver, start, 0.0))
                self.pass_cycle(driver)
            assert last > start.time_ns, "feedback never changed"

    def test_it_follows_a_slow_turn(self) -> None:
        """A turn of 0.02 rad at 0.2 rad/s arrives."""
        with self.opened() as driver:
            resting = self.turn(driver, driver.enable())
            feedback = self.hold(driver, resting, self.settle_cycles)
            self.assert_near(resting.q, feedback.q, "it stands beside the setpoint")

    def test_reads_and_writes_do_not_wait(self) -> None:
        """A driver that waits makes the servo miss deadlines, and stops come late."""
        with self.opened() as driver:
            start, allowed, taken = driver.enable(), driver.period_ns * 1e-9, [math.inf]
            for _ in range(3):  # a busy machine interrupts any driver
                taken = []
                for _ in range(30):
                    taken.append(self.seconds(driver.read))
                    taken.append(self.seconds(driver.write, self.setpoint(driver, start, 0.0)))
                    self.pass_cycle(driver)
                if sum(one >= allowed for one in taken) <= 2:
                    return
        raise AssertionError(f"reads or writes took {max(taken):.3g} s, longer than a period")

    def test_disabling_leaves_it_standing(self) -> None:
        """Disabled in motion it comes to rest; disabling is idempotent; enabling works again."""
        with self.opened() as driver:
            self.turn(driver, driver.enable())
            driver.disable()
            driver.disable()
            self.hold(driver, None, self.settle_cycles)
            before = self.hold(driver, None, 10)
            after = self.hold(driver, None, self.settle_cycles)
            self.assert_near(before.q, after.q, "it goes on moving")
            again = driver.enable()
            self.assert_near(again.q, after.q, "enabling it again moved it")
            self.hold(driver, self.setpoint(driver, again, 0.0), 3)

    def test_it_can_be_closed_twice_and_unopened(self) -> None:
        """Every way out of the servo process ends in close."""
        driver = self.make_driver()
        driver.close()
        with self.opened() as driver:
            driver.close()

    def test_an_unreachable_device_is_a_device_error(self) -> None:
        """The servo turns device errors into faults; anything else is a defect."""
        with self.opened() as driver:
            start = driver.enable()
            if not self.break_device():
                raise SkipTest("break_device cannot break it")
            self.assert_device_error(driver, start, 10 * self.settle_cycles)
            with contextlib.suppress(DeviceError):
                driver.disable()
            if self.mend_device() and isinstance(driver, Resettable):
                driver.reset()
                again = driver.enable()
                self.hold(driver, self.setpoint(driver, again, 0.0), self.settle_cycles)

    def test_a_device_that_is_not_there_is_a_device_error(self) -> None:
        """Opened, enabled or used, the driver says so by the right kind of error."""
        if not self.break_device():
            raise SkipTest("break_device cannot break it")
        driver = self.make_driver()
        try:
            driver.open()
            self.assert_device_error(driver, driver.enable(), 10 * self.settle_cycles)
        except DeviceError:
            pass
        finally:
            driver.close()

    def assert_device_error(self, driver: Driver, start: Feedback, cycles: int) -> None:
        """Assert that reading or writing raises one within some cycles."""
        try:
            self.hold(driver, self.setpoint(driver, start, 0.0), cycles)
        except DeviceError:
            return
        raise AssertionError("nothing was raised after the device had gone")

    # Optional protocols

    def test_a_reset_leaves_it_ready_to_be_enabled(self) -> None:
        """Resetting moves nothing, and works repeatedly."""
        with self.opened() as driver:
            device = self.offering(driver, Resettable)
            start = driver.enable()
            for _ in range(3):
                driver.disable()
                device.reset()
                again = driver.enable()
                self.assert_near(start.q, again.q, "a reset moved it")
                self.hold(driver, self.setpoint(driver, again, 0.0), 10)

    def test_it_rests_in_a_fault_whatever_it_is_sent(self) -> None:
        """A device that a fault has stopped must not move when it comes free."""
        with self.opened() as driver:
            device = self.offering(driver, RestsInFault)
            start = driver.enable()
            self.hold(driver, self.setpoint(driver, start, 0.0), 10)
            self.assert_quick(driver, device.rest_in_fault)
            feedback = self.hold(driver, self.setpoint(driver, start, _TURN), self.settle_cycles)
            self.assert_near(start.q, feedback.q, "it moved in a fault")
            driver.disable()
            if isinstance(driver, Resettable):
                driver.reset()
            again = driver.enable()
            self.assert_near(start.q, again.q, "it moved after a fault")

    def test_it_can_be_let_go_and_enabled_again(self) -> None:
        """While it can be moved by hand, it still reports its pose."""
        with self.opened() as driver:
            device = self.offering(driver, Freeable)
            driver.enable()
            driver.disable()
            device.free()
            self.hold(driver, None, self.settle_cycles)
            again = driver.enable()
            self.hold(driver, self.setpoint(driver, again, 0.0), 3)

    def test_it_can_be_parked_and_opened_again(self) -> None:
        """Parking is the last thing done to a device before its process ends."""
        with self.opened() as driver:
            device = self.offering(driver, Parkable)
            start = driver.enable()
            self.hold(driver, self.setpoint(driver, start, 0.0), 10)
            driver.disable()
            taken = self.seconds(device.park)
            assert taken <= _LONGEST_PARK, f"it took {taken:.3g} s"
        with self.opened() as driver:
            again = driver.enable()
            self.hold(driver, self.setpoint(driver, again, 0.0), 10)

    def test_an_unknown_option_of_a_motion_is_refused(self) -> None:
        """Options are looked at on a driver that is not open; a refusal changes nothing."""
        driver = self.offering(self.make_driver(), Tunable)
        driver.tune({})
        try:
            driver.tune({"no_such_option": 1})
        except ValueError as error:
            assert "no_such_option" in str(error), f"the message must name the option: {error}"
        else:
            raise AssertionError("an unknown option was accepted")

    def test_it_says_how_its_parts_are(self) -> None:
        """Health and notices are asked for once a second, in a cycle, enabled or not."""
        with self.opened() as driver:
            device = self.offering(driver, Healthy)
            for setpoint in (None, self.setpoint(driver, driver.enable(), 0.0)):
                for _ in range(10):
                    self.cycle(driver, setpoint)
                self.assert_quick(driver, device.health)
                self.assert_quick(driver, device.notices)
                assert all(isinstance(one, str) and one for one in device.notices())
                for part in device.health():
                    numbers = filter(None, (part.voltage, part.temperature, part.current))
                    assert all(map(math.isfinite, numbers)), f"not finite: {part}"
                    assert part.time_ns <= self.clock.now_ns(), f"from the future: {part}"

    def test_its_axes_arrive(self) -> None:
        """Held for long enough, each is within its own tolerance of where it was sent."""
        with self.opened() as driver:
            device = self.offering(driver, Arriving)
            self.hold(driver, self.turn(driver, driver.enable()), self.settle_cycles)
            self.assert_quick(driver, device.gaps)
            for axis in device.gaps():
                assert abs(axis.gap) <= axis.tolerance, f"it has not arrived: {axis}"
                assert 0.0 < axis.patience < math.inf, f"no such patience: {axis}"

    def test_its_speed_scaling_is_a_share(self) -> None:
        """The time scaling is multiplied with it."""
        with self.opened() as driver:
            device = self.offering(driver, Scaled)
            self.hold(driver, self.setpoint(driver, driver.enable(), 0.0), 10)
            assert 0.0 <= device.speed_scaling <= 1.0, f"it is {device.speed_scaling}"

    def test_it_shifts_deadlines_by_half_a_period_at_most(self) -> None:
        """After every cycle, from the first one on, to the nearest phase."""
        with self.opened() as driver:
            device = self.offering(driver, PhaseLocked)
            most, start = driver.period_ns // 2, None
            for k in range(self.settle_cycles):
                start = driver.enable() if k == 10 else start
                self.cycle(driver, start and self.setpoint(driver, start, 0.0))
                shift = device.deadline_shift_ns(self.clock.now_ns())
                assert isinstance(shift, int), f"a shift is whole nanoseconds, got {shift!r}"
                assert -most <= shift <= most, f"it shifts by {shift} ns of {driver.period_ns}"
            now_ns = self.clock.now_ns()
            self.assert_quick(driver, lambda: device.deadline_shift_ns(now_ns))

    def test_it_explains_itself_in_words(self) -> None:
        """Whatever the signal; empty if it does not know."""
        unopened = self.offering(self.make_driver(), Explaining)
        assert all(isinstance(unopened.why_ended(number), str) for number in range(1, 32))
        with self.opened() as driver:
            device = self.offering(driver, Explaining)
            self.hold(driver, self.setpoint(driver, driver.enable(), 0.0), 10)
            self.assert_quick(driver, device.why_stale)
            assert isinstance(device.why_stale(), str)

    def test_what_it_is_asked_in_a_cycle_never_raises(self) -> None:
        """Before the first read, enabled, in motion, disabled, and without its device."""
        with self.opened() as driver:
            self.ask_in_a_cycle(driver)
            start = driver.enable()
            self.ask_in_a_cycle(driver)
            self.turn(driver, start)
            self.ask_in_a_cycle(driver, has_moved=True)
            driver.disable()
            self.ask_in_a_cycle(driver, has_moved=True)
            if self.break_device():
                with contextlib.suppress(DeviceError):
                    self.hold(driver, None, self.settle_cycles)
                self.ask_in_a_cycle(driver, has_moved=True)

    def ask_in_a_cycle(self, driver: Driver, *, has_moved: bool = False) -> None:
        """Call every optional method that the servo calls in a cycle, some only after a motion."""
        if isinstance(driver, Explaining):
            assert isinstance(driver.why_stale(), str)
        if isinstance(driver, Healthy):
            driver.health()
            driver.notices()
        if has_moved and isinstance(driver, Arriving):
            driver.gaps()
        if isinstance(driver, PhaseLocked):
            driver.deadline_shift_ns(self.clock.now_ns())
        if isinstance(driver, Scaled):
            assert 0.0 <= driver.speed_scaling <= 1.0, f"it is {driver.speed_scaling}"

    def test_it_diagnoses_a_device_that_is_well(self) -> None:
        """Every finding has words, and all but the good ones say what to do."""
        for one in self.offering(self.make_driver(), Diagnosable).diagnose():
            assert isinstance(one, Finding), f"no finding: {one!r}"
            assert min(one.name, one.found), f"no words: {one}"
            assert one.mend or one.verdict is Verdict.OK, f"what to do about it? {one}"

    def test_it_says_where_an_offline_plan_begins(self) -> None:
        """Asked or not; options that do not say enough are a plan error."""
        for from_device in (False, True):
            driver = self.offering(self.make_driver(), Locatable)
            with contextlib.suppress(PlanError):
                start = driver.offline_start(from_device=from_device)
                assert start is None or abs(math.hypot(*start.q) - 1.0) < 1e-9, (
                    f"no orientation: {start}"
                )

    def test_its_mechanism_poses_the_tool_as_it_reports(self) -> None:
        """The device reaches the poses that are planned with its mechanism."""
        with self.opened() as driver:
            start = driver.enable()
            mechanism = self.offering(driver, Mechanical).mechanism(may_ask=True)
            if mechanism is None:
                raise SkipTest("it is planned for without its axes")
            assert len(mechanism.axes) == len(start.joints), f"{len(mechanism.axes)} axes"
            self.assert_near(mechanism.forward(start.joints)[0], start.q, "its pose is off")
        for line in mechanism.outline(start.joints):
            assert len(line) >= 2, f"a line of {len(line)} points"
            assert all(len(point) == 3 and all(map(math.isfinite, point)) for point in line)
