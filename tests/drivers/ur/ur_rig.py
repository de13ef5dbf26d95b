"""A device of the daemon on an emulated robot, without the daemon."""

import math
import time
from contextlib import contextmanager

import harness
import numpy as np
from direct_planners import DirectPlanners, plan, run

from orientd import rotation
from orientd.clock import MonotonicClock
from orientd.config import DeviceSettings
from orientd.daemon.device import Device, servo_limits_of
from orientd.driver import Setpoint
from orientd.errors import DeviceError, Fault
from orientd.floats import exp, multiply
from orientd.model.request import Keyframe, MotionRequest
from orientd.stream.records import ServoState
from orientd_ur import UrDriver
from orientd_ur.wire import Dashboard

# A busy machine may let nobody run for longer than a real controller ever pauses.
PATIENT = {"feedback_timeout": 1.0, "heartbeat_timeout": 3.0}
PATIENT_DRIVER = {"feedback_timeout": 0.3, "watchdog_hz": 1.5}


def until(claim, what, seconds=30.0):
    ends = time.monotonic() + seconds
    while not (found := claim()):
        if time.monotonic() > ends:
            said = what() if callable(what) else what
            raise AssertionError(f"{said}: not within {seconds} s")
        time.sleep(0.001)
    return found


def press(host, *buttons):
    """Send lines to the dashboard server, one behind another; return the last answer."""
    with Dashboard(host) as dashboard:
        return [dashboard.ask(button) for button in buttons][-1]


@contextmanager
def device_of(host, *, compensate_latency=False, on_event=lambda _event: None, **options):
    """A device, enabled, with its servo process."""
    is_patient = harness.MACHINE.is_patient
    settings = DeviceSettings(
        name="arm",
        driver="ur",
        priority=0,
        compensate_latency=compensate_latency,
        options={
            "host": host,
            "lookahead": 0.03,
            **(PATIENT_DRIVER if is_patient else {}),
            **options,
        },
        **(PATIENT if is_patient else {}),
    )
    with launched(settings, DirectPlanners([settings]), on_event) as device:
        assert device.wait_ready(20.0), device.failure
        until(lambda: device.snapshot().state is ServoState.HOLDING, "holding")
        yield device


@contextmanager
def launched(settings, planners=None, on_event=lambda _event: None):
    """A device with its servo process, whatever becomes of it."""
    device = Device(settings, planners=planners, on_event=on_event)
    device.launch()
    try:
        yield device
    finally:
        device.shutdown()


def swing_motion(device, *, angle=0.3, seconds=3.0, count=1, home=None, **fields):
    """Plan *count* turns from *home*, else from here, about one of the tool's axes and back."""
    start = device.commanded()
    home = start.q if home is None else home
    away = rotation.multiply(home, rotation.exp(angle * np.array([0.0, 0.6, 0.8])))
    keyframes = [
        Keyframe(away if k % 2 else home if k else start.q, k * seconds / 2)
        for k in range(2 * count + 1)
    ]
    return plan(device, MotionRequest(keyframes=keyframes, **fields))


def swing(device, **settings):
    """Start a turn and back, and return what runs."""
    return run(device, swing_motion(device, **settings))


def begin_to_track(device, tolerance=math.inf):
    """Have a device follow targets; its tool may leave a straight line by *tolerance*, m."""
    with device.expecting() as queued:
        device.track(queued, servo_limits_of(device.limits, 1.0, tolerance))


def is_holding(device):
    return device.snapshot().state is ServoState.HOLDING


def streaming(device):
    """Wait until setpoints have moved for a while."""
    until(lambda: device.snapshot().path_time > 0.3, lambda: f"streaming {device.snapshot()}")


def fault_of(device, seconds=20.0):
    """Wait for a fault; return it, its text and how long it took."""
    begun = time.monotonic()
    until(lambda: device.snapshot().fault is not Fault.NONE, "a fault", seconds)
    took = time.monotonic() - begun
    # The words come by another way than the state, up to 10 ms later.
    until(lambda: device.snapshot().fault_text, "the fault in words")
    snapshot = device.snapshot()
    return snapshot.fault, snapshot.fault_text, took


def recover(device):
    """Reset, then move again."""
    device.reset()
    until(lambda: is_holding(device), lambda: f"holding after the reset {device.snapshot()}")
    swing(device, angle=0.05, seconds=0.6)
    streaming(device)
    until(lambda: is_holding(device), lambda: f"the end after the reset {device.snapshot()}")
    assert device.snapshot().fault is Fault.NONE


def unopened(host, *, rate_hz=500, **options):
    """A driver that is not open yet."""
    period_ns = round(1e9 / rate_hz)
    return UrDriver({"host": host, **options}, period_ns=period_ns, clock=MonotonicClock())


@contextmanager
def driver_of(host, **options):
    """A driver that is open."""
    driver = unopened(host, **{"watchdog_hz": 1.5, "feedback_timeout": 0.5, **options})
    try:
        driver.open()
        yield driver
    finally:
        driver.close()


class Stream:
    """A driver that is streamed to, cycle by cycle, as the servo does it.

    Attributes:
        driver: the driver.
        begin: where it was enabled.
        q, position: last setpoint.
        is_faulty: whether the driver has raised an error, and was stopped for it.
    """

    def __init__(self, driver):
        self.driver = driver
        self.start()

    def start(self):
        """Enable the driver; the next setpoints begin where the arm is."""
        self.begin = self.driver.enable()
        self.q, self.position, self.is_faulty = self.begin.q, self.begin.position, False

    def send(self, turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
        """Write a setpoint that is turned about axes of the tool, and shifted, from the last."""
        self.q = multiply(self.q, exp(turn))
        self.position = tuple(a + b for a, b in zip(self.position, shift, strict=True))
        self.driver.write(Setpoint(0, self.q, position=self.position))

    def step(self, turn=(0.0, 0.0, 0.0)):
        """Run a cycle; return the feedback."""
        feedback = self.driver.read()
        self.send(turn)
        time.sleep(self.driver.period_ns * 1e-9)
        return feedback

    def run(self, seconds, rate=0.0, axis=(0.0, 0.0, 1.0)):
        """Turn the tool, rad/s, about its own *axis* for a time; stop at an error."""
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            self.cycle(rate, axis)

    def cycle(self, rate=0.0, axis=(0.0, 0.0, 1.0)):
        """Run a cycle as the servo does, with an error or after one."""
        try:
            if not self.is_faulty:
                self.step(tuple(self.driver.period_ns * 1e-9 * rate * a for a in axis))
                return
            self.driver.read()
        except DeviceError:
            self.is_faulty = True
            self.driver.rest_in_fault()
            self.driver.disable()
        time.sleep(self.driver.period_ns * 1e-9)

    def step_for(self, seconds):
        """Run cycles with the last setpoint, up to the first error."""
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            self.step()

    def read_for(self, seconds):
        """Run cycles without setpoints, up to the first error."""
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            self.driver.read()
            time.sleep(self.driver.period_ns * 1e-9)


@contextmanager
def stream_of(host, **options):
    """A driver that is enabled and can be streamed to."""
    with driver_of(host, **options) as driver:
        yield Stream(driver)


def push(robot, angles):
    """Move the stopped arm by hand; return where it then stands."""
    still = robot.wait_until(lambda s: s["is_still"])
    return bring(robot, [q + a for q, a in zip(still["actual_q"], angles, strict=True)])


def bring(robot, joints):
    """Move the stopped arm by hand to *joints*; return where it then stands."""
    robot.ask(f"push {' '.join(map(str, joints))} 0.4")
    is_there = lambda s: s["is_still"] and math.dist(s["actual_q"], joints) < 1e-6  # noqa: E731
    return robot.wait_until(is_there)["actual_q"]
