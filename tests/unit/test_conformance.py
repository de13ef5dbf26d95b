"""The conformance suite passes a good driver and fails bad ones, each by the test that says why."""

import inspect
import math
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from unittest import SkipTest

import pytest

from emulated_dynamixel import ManualClock
from orientd import driver as offered
from orientd.clock import MonotonicClock
from orientd.driver import (
    IDENTITY,
    AxisGap,
    AxisLimits,
    Driver,
    Feedback,
    Finding,
    PartHealth,
    Resettable,
    Verdict,
    check_names,
)
from orientd.errors import DeviceFaultError, LinkError
from orientd.floats import difference, exp, log, multiply, norm
from orientd.mechanism import Mechanical, Mechanism
from orientd.testing import DriverConformance

PERIOD_NS = 2_000_000
PERIOD = PERIOD_NS * 1e-9
MOST = 0.0201
"""Longest step that a driver is asked for: to the end of the suite's turn, in a fault; rad."""
ALL = (*(one for one in vars(offered).values() if getattr(one, "_is_protocol", False)), Mechanical)


@dataclass
class Device:
    """A body that is where it was last sent, and outlives the drivers of it."""

    q: tuple = exp((0.1, 0.2, 0.3))
    is_there: bool = True
    is_at_rest: bool = False


class Turning(Mechanism):
    """Three axes whose angles are the rotation vector."""

    axes = tuple(AxisLimits(name, -3.0, 3.0, 2.0) for name in "xyz")

    def forward(self, joints):
        return exp(joints), (0.0, 0.0, 0.0)

    def solutions(self, q, position):
        return [log(q)]

    def outline(self, joints):
        return [[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]]


class Body(Driver):
    """The six methods."""

    name = "good"

    def __init__(self, options, *, period_ns, clock):
        super().__init__(options, period_ns=period_ns, clock=clock)
        check_names(options, ("device",))
        self.device = options["device"]
        self.is_enabled = False
        self.omega = (0.0, 0.0, 0.0)

    def require(self):
        if not self.device.is_there:
            raise LinkError("the device is gone")

    def report(self):
        q = self.device.q
        return Feedback(self.clock.now_ns(), q, self.omega, joints=log(q))

    def open(self):
        self.require()

    def enable(self):
        self.require()
        assert not self.is_enabled
        if self.device.is_at_rest and isinstance(self, Resettable):
            raise DeviceFaultError("reset it first")
        self.device.is_at_rest = False
        self.is_enabled, self.asked = True, self.device.q
        return self.report()

    def read(self):
        self.require()
        return self.report()

    def write(self, setpoint):
        self.require()
        assert self.is_enabled
        assert norm(difference(self.asked, setpoint.q)) < MOST, "no such step is to be asked for"
        assert norm(setpoint.omega_body) < MOST / PERIOD
        assert setpoint.q != self.asked or not norm(setpoint.omega_body), "it stands still"
        self.asked = setpoint.q
        if not self.device.is_at_rest:
            self.device.q, self.omega = setpoint.q, setpoint.omega_body

    def disable(self):
        self.is_enabled, self.omega = False, (0.0, 0.0, 0.0)

    def close(self):
        self.is_enabled = False


class Offers:
    """All that is optional."""

    def reset(self):
        self.require()
        self.device.is_at_rest = False

    def rest_in_fault(self):
        self.device.is_at_rest = True

    def free(self):
        assert not self.is_enabled

    def park(self):
        assert not self.is_enabled

    def tune(self, options):
        check_names(options, ("gain",))

    def health(self):
        return [PartHealth("body", self.clock.now_ns(), 12.0)]

    def notices(self):
        return ["it is a good device"]

    def gaps(self):
        return [AxisGap("body", 0.0, 0.01)]

    @property
    def speed_scaling(self):
        return 0.5

    def deadline_shift_ns(self, deadline_ns):
        return PERIOD_NS // 2

    def why_stale(self):
        return "nobody is late"

    def why_ended(self, signal):
        return ""

    def diagnose(self):
        return [Finding("body", "there", Verdict.OK)]

    def offline_start(self, *, from_device):
        return self.report()

    def mechanism(self, *, may_ask):
        return Turning()


class GoodDriver(Offers, Body):
    """Offers every protocol, and keeps what it promises."""


def lacking(*names):
    """Return a class of drivers without the optional methods of these names."""
    kept = {name: one for name, one in vars(Offers).items() if name not in names}
    return type("Lesser", (type("Some", (), kept), Body), {})


class Suite(DriverConformance):
    protocols = ALL

    def __init__(self, kind=GoodDriver):
        self.kind = kind
        self.clock = ManualClock(10**9)
        self.device = Device()

    def make_driver(self):
        return self.kind({"device": self.device}, period_ns=PERIOD_NS, clock=self.clock)

    def pass_cycle(self, driver):
        self.clock.advance(PERIOD_NS)

    def break_device(self):
        self.device.is_there = False
        return True

    def mend_device(self):
        self.device.is_there = True
        return True


LOADS = "test_it_loads_nothing_that_the_servo_process_must_not"
NAMES = [name for name, _ in inspect.getmembers(DriverConformance) if name.startswith("test_")]


def outcome(suite, name):
    try:
        getattr(suite, name)()
    except SkipTest:
        return "skipped"
    except Exception as error:  # noqa: BLE001 - whatever a test fails by
        return f"{type(error).__name__}: {error}"
    return "passed"


@pytest.mark.parametrize("name", sorted(set(NAMES) - {LOADS}))
def test_a_good_driver_passes(name):
    assert outcome(Suite(), name) == "passed"


@pytest.mark.parametrize("name", [name for name in NAMES if "is_a_device_error" in name])
def test_a_device_that_cannot_be_broken_is_skipped(name):
    class Unbreakable(Suite):
        break_device = DriverConformance.break_device

    assert outcome(Unbreakable(), name) == "skipped"


@pytest.mark.parametrize("protocol", ALL, ids=lambda one: one.__name__)
def test_a_protocol_that_is_not_offered_is_skipped(protocol):
    kind = lacking(*(name for name in vars(protocol) if not name.startswith("_")))
    results = []
    for name in set(NAMES) - {LOADS}:
        suite = Suite(kind)
        suite.protocols = ()
        results.append(outcome(suite, name))
    assert results.count("skipped") == 1
    assert set(results) == {"passed", "skipped"}


def compute(seconds):
    """Keep the processor busy until this thread has had it for *seconds*."""
    ends = time.thread_time() + seconds
    while time.thread_time() < ends:
        pass


def test_processor_time_of_other_programs_is_not_a_drivers():
    suite, processors = Suite(), os.sched_getaffinity(0)
    suite.clock = MonotonicClock()
    os.sched_setaffinity(0, {min(processors)})
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        compute(0.05)
        begun = time.perf_counter()
        taken = suite.seconds(compute, 0.1)
        in_all = time.perf_counter() - begun
    finally:
        for one in others:
            one.kill()
            one.wait()
        os.sched_setaffinity(0, processors)
    assert 0.099 < taken < 0.6 * in_all


def test_waiting_counts_as_a_drivers_time():
    suite = Suite()
    suite.clock = MonotonicClock()
    assert suite.seconds(time.sleep, 0.02) > 0.019


# Bad drivers, each with the tests that it fails.


def later(q):
    """Return *q* turned a little."""
    return multiply(q, exp((0.0, 0.0, 0.001)))


READS = "test_reads_and_writes_do_not_wait"
HEALTH = "test_it_says_how_its_parts_are"
OFFERS = "test_it_offers_what_it_is_meant_to"
PARKS = "test_it_can_be_parked_and_opened_again"
RESETS = "test_a_reset_leaves_it_ready_to_be_enabled"
IS_POSE = "test_feedback_is_a_pose"
STAMPS = "test_feedback_is_stamped_when_it_was_measured"
ENABLES = "test_enabling_and_holding_does_not_move_it"
GONE = "test_an_unreachable_device_is_a_device_error"
NOT_THERE = "test_a_device_that_is_not_there_is_a_device_error"
DISABLES = "test_disabling_leaves_it_standing"
SHIFTS = "test_it_shifts_deadlines_by_half_a_period_at_most"
RESTS = "test_it_rests_in_a_fault_whatever_it_is_sent"
FOLLOWS = "test_it_follows_a_slow_turn"
ASKED = "test_what_it_is_asked_in_a_cycle_never_raises"
FREES = "test_it_can_be_let_go_and_enabled_again"
TUNES = "test_an_unknown_option_of_a_motion_is_refused"
ARRIVES = "test_its_axes_arrive"
SCALES = "test_its_speed_scaling_is_a_share"
EXPLAINS = "test_it_explains_itself_in_words"
BEGINS = "test_it_says_where_an_offline_plan_begins"
NAMED = "test_its_class_has_a_name_and_a_rate"
POSES = "test_its_mechanism_poses_the_tool_as_it_reports"


def waiting(name, periods):
    """Return a method that takes so many periods, and then does what it should."""

    def method(driver, *arguments, **fields):
        driver.clock.advance(round(periods * PERIOD_NS))
        return getattr(GoodDriver, name)(driver, *arguments, **fields)

    return method


def returning(value):
    """Return a method with this result."""
    return lambda driver, *arguments, **fields: value


def raising(error):
    """Return a method that raises."""

    def method(driver, *arguments, **fields):
        raise error

    return method


def reporting(**fields):
    """Return a method that reports these fields of the feedback wrongly, by value or function."""

    def method(driver):
        wrong = {name: one(driver) if callable(one) else one for name, one in fields.items()}
        return GoodDriver.report(driver)._replace(**wrong)

    return method


def beginning_nowhere(*, if_asked):
    """Return a method that says no start of an offline plan if the device is asked, or if not."""

    def method(driver, *, from_device):
        is_wrong = from_device is if_asked
        return driver.report()._replace(q=(0.0,) * 4) if is_wrong else driver.report()

    return method


def health(ahead_ns=0, value=12.0):
    """Return a method that reports the health of one part."""
    return lambda driver: [PartHealth("body", driver.clock.now_ns() + ahead_ns, value)]


# What is wrong, the test that fails by it, and what the driver does in place of the good one.
WRONG = {
    "it waits in read": (READS, {"read": waiting("read", 10)}),
    "it waits in write": (READS, {"write": waiting("write", 10)}),
    "its read takes more than a period": (READS, {"read": waiting("read", 1.5)}),
    "it raises in health": (HEALTH, {"health": raising(LinkError("asked in vain"))}),
    "it waits in health": (HEALTH, {"health": waiting("health", 10)}),
    "it waits in notices": (HEALTH, {"notices": waiting("notices", 1.5)}),
    "its health is not a number": (HEALTH, {"health": health(value=math.nan)}),
    "its health is from the future": (HEALTH, {"health": health(1)}),
    "it raises in notices": (HEALTH, {"notices": raising(KeyError("notices"))}),
    "its notices are no words": (HEALTH, {"notices": returning(5)}),
    "a notice is no text": (HEALTH, {"notices": returning([5])}),
    "a notice is empty": (HEALTH, {"notices": returning([""])}),
    "it shifts by a period": (SHIFTS, {"deadline_shift_ns": returning(PERIOD_NS)}),
    "it shifts back too far": (SHIFTS, {"deadline_shift_ns": returning(-PERIOD_NS // 2 - 1)}),
    "its shift is no whole number": (SHIFTS, {"deadline_shift_ns": returning(0.5)}),
    "park raises": (PARKS, {"park": raising(ZeroDivisionError())}),
    "it is parked for good": (
        PARKS,
        {"park": lambda driver: setattr(driver.device, "is_there", False)},
    ),
    "park takes a minute": (PARKS, {"park": waiting("park", 60.0 / PERIOD)}),
    "its feedback is not a number": (IS_POSE, {"report": reporting(omega_body=(math.nan, 0, 0))}),
    "its feedback lacks an axis": (IS_POSE, {"report": reporting(omega_body=(0.0, 0.0))}),
    "its feedback has nine joints": (IS_POSE, {"report": reporting(joints=(0.0,) * 9)}),
    "the time of its feedback is no whole number": (
        IS_POSE,
        {"report": reporting(time_ns=lambda driver: float(driver.clock.now_ns()))},
    ),
    "its orientation has no unit norm": (
        IS_POSE,
        {"report": reporting(q=lambda driver: tuple(1.001 * part for part in driver.device.q))},
    ),
    "its feedback is no feedback": (IS_POSE, {"read": lambda driver: (*driver.report(),)}),
    "its feedback is from the future": (
        STAMPS,
        {"report": reporting(time_ns=lambda driver: driver.clock.now_ns() + 1)},
    ),
    "its joints are of another mechanism": (
        POSES,
        {"report": reporting(joints=lambda driver: log(later(driver.device.q)))},
    ),
    "it does not notice that the device is gone": (GONE, {"require": returning(None)}),
    "it does not notice that there is no device": (NOT_THERE, {"require": returning(None)}),
    "it cannot say why without its device": (
        ASKED,
        {"why_stale": lambda driver: driver.require() or ""},
    ),
    "its feedback never changes": (STAMPS, {"read": reporting(time_ns=10**9)}),
    "it takes any option of a motion": (TUNES, {"tune": returning(None)}),
    "it moves in a fault": (RESTS, {"rest_in_fault": returning(None)}),
    "it never arrives": (ARRIVES, {"gaps": returning([AxisGap("body", -0.02, 0.01)])}),
    "it waits in gaps": (ARRIVES, {"gaps": waiting("gaps", 1)}),
    "it waits for ever": (
        ARRIVES,
        {"gaps": returning([AxisGap("body", 0.0, 0.01, patience=math.inf)])},
    ),
    "it is scaled by per cent": (SCALES, {"speed_scaling": 100.0}),
    "it runs faster than asked": (SCALES, {"speed_scaling": 1.01}),
    "it explains nothing": (EXPLAINS, {"why_stale": returning(None)}),
    "it explains at length": (EXPLAINS, {"why_stale": waiting("why_stale", 1)}),
    "it knows no signal but one": (
        EXPLAINS,
        {"why_ended": lambda driver, signal: {9: "killed"}[signal]},
    ),
    "it leaves one alone with a problem": (
        "test_it_diagnoses_a_device_that_is_well",
        {"diagnose": returning([Finding("body", "broken", Verdict.PROBLEM)])},
    ),
    "it begins nowhere": (
        BEGINS,
        {"offline_start": returning(Feedback(0, (0.0, 0.0, 0.0, 0.0)))},
    ),
    "it begins nowhere if the device is asked": (
        BEGINS,
        {"offline_start": beginning_nowhere(if_asked=True)},
    ),
    "it begins nowhere unasked": (BEGINS, {"offline_start": beginning_nowhere(if_asked=False)}),
    "it has no name": (NAMED, {"name": ""}),
    "it has no rate": (NAMED, {"default_rate_hz": 0.0}),
    "it declares no time": (OFFERS, {"longest_call": 0.0}),
    "it loads NumPy": (LOADS, {"__module__": "orientd.rotation"}),
}
BAD = [
    pytest.param(type("Bad", (GoodDriver,), instead), name, id=wrong)
    for wrong, (name, instead) in WRONG.items()
]


def bad(*names):
    """Keep a class of drivers that fails by the tests of these names."""

    def keep(kind):
        BAD.extend(pytest.param(kind, name, id=f"{kind.__name__}-{name}") for name in names)
        return kind

    return keep


class Counting(GoodDriver):
    count = 0

    def every(self, n):
        self.count += 1
        return self.count % n == 0


@bad(READS)
class WaitsNowAndThen(Counting):
    def read(self):
        self.clock.advance(10 * PERIOD_NS if self.every(8) else 0)
        return super().read()


@bad(OFFERS)
class ParkIsMisspelt(lacking("park")):
    def parc(self):
        pass


@bad(RESETS)
class ResetWearsOff(Counting):
    def reset(self):
        super().reset()
        self.device.is_at_rest = self.every(3)


@bad(RESETS)
class CannotBeWrittenToOnceReset(GoodDriver):
    was_reset = False

    def reset(self):
        super().reset()
        self.was_reset = True

    def write(self, setpoint):
        assert not self.was_reset
        super().write(setpoint)


@bad(RESETS)
class ResetMovesIt(GoodDriver):
    def reset(self):
        super().reset()
        self.device.q = later(self.device.q)


@bad(ASKED)
class CannotSayWhyBeforeTheFirstRead(GoodDriver):
    newest = None

    def read(self):
        self.newest = super().read()
        return self.newest

    def why_stale(self):
        return f"since {self.newest.time_ns}"


@bad(ASKED)
class KnowsNoGapsAfterAMotion(GoodDriver):
    def gaps(self):
        assert not self.asked
        return super().gaps()


@bad(IS_POSE)
class CannotBeReadBeforeItIsEnabled(GoodDriver):
    def read(self):
        if not self.is_enabled:
            raise AttributeError("newest")
        return super().read()


@bad(STAMPS)
class FeedbackGoesBack(Counting):
    def read(self):
        back = 3 * PERIOD_NS if self.every(5) else 0
        return super().read()._replace(time_ns=self.clock.now_ns() - back)


@bad(ENABLES)
class MovesOnEnable(GoodDriver):
    def enable(self):
        start = super().enable()
        self.device.q = later(start.q)
        return start

    def write(self, setpoint):
        super().write(setpoint._replace(q=later(setpoint.q)))


@bad(ENABLES)
class GoesHomeOnEnable(GoodDriver):
    def enable(self):
        self.device.q = IDENTITY
        return super().enable()


@bad(GONE, NOT_THERE)
class RaisesSomethingElse(GoodDriver):
    def require(self):
        if not self.device.is_there:
            raise OSError(5, "Input/output error")


@bad(GONE)
class CannotBeResetOnceGone(GoodDriver):
    def reset(self):
        if not self.device.is_there or self.__dict__.get("was_gone"):
            raise LinkError("gone")

    def disable(self):
        super().disable()
        self.was_gone = not self.device.is_there


@bad(GONE)
class CannotBeWrittenToOnceMended(GoodDriver):
    was_gone = False

    def write(self, setpoint):
        self.was_gone = self.was_gone or not self.device.is_there
        super().write(setpoint)
        assert not self.was_gone

    def read(self):
        self.was_gone = self.was_gone or not self.device.is_there
        return super().read()


@bad(DISABLES)
class IgnoresDisable(GoodDriver):
    def disable(self):
        pass

    def read(self):
        self.device.q = multiply(self.device.q, exp(tuple(PERIOD * part for part in self.omega)))
        return super().read()


@bad(DISABLES)
class CannotBeDisabledTwice(GoodDriver):
    def disable(self):
        assert self.is_enabled
        super().disable()


@bad(DISABLES)
class CannotBeWrittenToOnceDisabled(GoodDriver):
    was_disabled = False

    def disable(self):
        super().disable()
        self.was_disabled = True

    def write(self, setpoint):
        assert not self.was_disabled
        super().write(setpoint)


@bad("test_an_unknown_option_is_refused_by_name")
class TakesAnyOption(GoodDriver):
    def __init__(self, options, *, period_ns, clock):
        known = {"device": options["device"]}
        super().__init__(known, period_ns=period_ns, clock=clock)


@bad(RESTS)
class MovesAfterAFault(GoodDriver):
    def reset(self):
        if self.device.is_at_rest:
            self.device.q = later(self.device.q)
        super().reset()


@bad(FOLLOWS)
class StopsShort(GoodDriver):
    def write(self, setpoint):
        if norm(difference(setpoint.q, exp((0.1, 0.2, 0.3)))) < 0.015:
            super().write(setpoint)


@bad(FREES)
class SaysNothingWhileFree(GoodDriver):
    is_free = False

    def free(self):
        self.is_free = True

    def read(self):
        return None if self.is_free else super().read()


@bad(POSES)
class DrawsAPoint(GoodDriver):
    def mechanism(self, *, may_ask):
        mechanism = Turning()
        mechanism.outline = lambda joints: [[(0.0, 0.0, 0.0)]]
        return mechanism


class Opening(GoodDriver):
    is_open = None

    def open(self):
        super().open()
        self.is_open = True


@bad(TUNES)
class NeedsOptionsOfEveryMotion(GoodDriver):
    def tune(self, options):
        super().tune(options)
        assert options


@bad("test_it_can_be_closed_twice_and_unopened")
class CannotBeClosedTwice(Opening):
    def close(self):
        assert self.is_open is not False
        self.is_open = self.is_open and False


@bad("test_it_can_be_closed_twice_and_unopened")
class CannotBeClosedUnopened(Opening):
    def close(self):
        assert self.is_open is not None


@pytest.mark.parametrize("name", [FOLLOWS, GONE, NOT_THERE])
def test_every_driver_that_was_made_is_closed(name):
    made, closed = [], []

    class Closing(GoodDriver):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append(self)

        def close(self):
            super().close()
            closed.append(self)

    assert outcome(Suite(Closing), name) == "passed"
    assert made
    assert made == closed


class TakesJoints(GoodDriver):
    takes = "joints"

    def write(self, setpoint):
        assert setpoint.joints
        super().write(setpoint._replace(q=exp(setpoint.joints)))


@pytest.mark.parametrize("name", [FOLLOWS, ENABLES, RESTS, DISABLES])
def test_a_driver_that_takes_joints_is_sent_joints(name):
    assert outcome(Suite(TakesJoints), name) == "passed"


@bad(FOLLOWS)
class TakesJointsWithoutAMechanism(TakesJoints):
    def mechanism(self, *, may_ask):
        return None


@bad(FOLLOWS)
class TakesJointsOfAnother(TakesJoints):
    def write(self, setpoint):
        super().write(setpoint._replace(joints=tuple(-angle for angle in setpoint.joints)))


@pytest.mark.parametrize(("kind", "name"), BAD)
def test_a_bad_driver_fails(kind, name):
    assert outcome(Suite(kind), name) not in ("passed", "skipped")


def test_eight_joints_are_as_many_as_there_may_be():
    class Eight(GoodDriver):
        def report(self):
            return super().report()._replace(joints=(0.0,) * 8)

    assert outcome(Suite(Eight), IS_POSE) == "passed"


def test_half_of_a_protocol_is_named():
    suite = Suite(lacking("health"))
    suite.protocols = ()
    assert outcome(suite, OFFERS) == "AssertionError: Healthy lacks health"


def test_a_module_that_loads_little_passes():
    class Small(GoodDriver):
        pass

    Small.__module__ = "orientd_loopback"
    assert outcome(Suite(Small), LOADS) == "passed"
