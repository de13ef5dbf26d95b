"""A whole system in virtual time: daemon, planner, servo, driver, device and clients, one seed.

The daemon's own classes run unchanged, from the calls of its service down to the rings.  So does
the servo process with its loop of cycles.  Each process is a group of tasks of one scheduler.  The
sockets and processes between them are left out: a client calls the service itself, and the plan is
made in place, after a time that the seed decides.  The seed also decides on faults:

* link: it is lost or reset, feedback is late, lost or stale, a setpoint is not taken, the device
  has a fault;
* process: the servo or the daemon is killed, stands still and goes on, or is late;
* disk: it is full, slow or read only;
* clock: the wall clock is set, or the whole machine stands still.

Meanwhile every setpoint keeps the limits, and every refusal is an error of orientd's own.  Every
call has its answer in time.  After a stop or the loss of its client, the device comes to rest.
Afterwards no motion is unfinished, the device moves after a reset, and all processes end.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path
from unittest import mock

from emulated_device import EmulatedDevice, EmulatedDriver
from faults import Disk
from judge import limits_of
from processes import Planners, Process, of_servos
from virtual_time import BEGIN_NS, Scheduler, VirtualLoop, virtual_time

from orientd import config
from orientd.clock import MonotonicClock
from orientd.daemon import server
from orientd.daemon.calls.service import Service
from orientd.daemon.device import EventKind
from orientd.daemon.devices import Devices
from orientd.daemon.observe import flight_recorder
from orientd.errors import OrientdError
from orientd.servo import process as servo_process

LIMITS = {
    "velocity": 2.0,
    "acceleration": 8.0,
    "jerk": 200.0,
    "linear_velocity": 0.5,
    "linear_acceleration": 2.0,
}
SLOW_DEVICE = {
    "daemon": {"lease_seconds": 2.0},
    "recorder": {"seconds": 5.0},
    "devices": {"arm": {"driver": "loopback", "rate_hz": 50.0, "limits": LIMITS}},
}
SETTINGS = {"shipped": {"devices": {"arm": {"driver": "loopback"}}}, "slow": SLOW_DEVICE}
"""The configurations by name: what is shipped, at 500 Hz, and a device of 50 Hz."""

CALM_NS = 5_000_000_000
"""Longest time for which a past fault may still have effects."""


class Daemon:
    """One run of the daemon: its service and its loop."""

    def __init__(self, system, number):
        self.system, self.group = system, f"daemon {number}"
        self.loop = VirtualLoop(system.scheduler)
        self.is_serving = self.has_ended = self.was_frozen = False
        self.devices = self.service = None
        self.callers = []
        system.scheduler.spawn(self._run, "daemon", self.group)

    def _run(self):
        self.loop.set_exception_handler(self._note)
        self.loop.run_until_complete(self._serve())
        self.has_ended = True

    def end(self):
        """Terminate, as at SIGTERM."""
        self.loop.call_soon_threadsafe(self._ending.set)

    def leave(self):
        """Report to every caller that the daemon has gone."""
        for task in self.callers:
            self.system.scheduler.wake(task)

    def _note(self, _loop, context):
        error = context.get("exception")
        if not isinstance(error, OrientdError):
            self.system.problems.append(f"event loop: {context['message']}: {error!r}")

    async def _serve(self):
        system = self.system
        settings = system.settings
        planners = Planners(settings.devices.values(), system.random)
        self.devices = Devices(
            settings, planners=planners, clock=MonotonicClock(), on_event=self._hear
        )
        self.service = Service(
            self.devices, keyframes=100, socket=Path("/run/x"), configuration="", began=0.0
        )
        life = server.Threads(1, "life")
        await life.run(self.devices.launch)
        expiring = asyncio.create_task(server._expire_leases(self.devices))
        self._ending = asyncio.Event()
        self.is_serving = True
        await self._ending.wait()
        self.is_serving = False
        self.leave()
        expiring.cancel()
        await life.run(self.devices.shutdown)
        life.close()
        self.service.end_calls()
        self.devices.close()

    def _hear(self, event, _device):
        """Note events, and failures that occur without a fault."""
        system = self.system
        system.note("event", event.kind.value, event.text)
        if event.kind in (EventKind.FAULT, EventKind.SERVO_DIED) and system.is_calm:
            system.tell(f"{event.kind.value}: {event.text}")
        if event.kind is EventKind.RECORDING_FAILED and not system.disk.fault:
            system.tell(f"{event.kind.value}: {event.text}")

    def call(self, what):
        """Have a coroutine run in the loop, and return its future."""
        return asyncio.run_coroutine_threadsafe(what, self.loop)


class System:
    """The whole system, for as long as a test runs it.

    Attributes:
        problems: what must never happen, and did.
        counts: how often what happened.
        history: digest of every setpoint, event and answer, each with its time.
    """

    def __init__(self, seed, name="slow"):
        self.seed, self.settings = seed, config.parse(SETTINGS[name], source="emulated")
        self.scheduler = Scheduler(seed)
        self.random = self.scheduler.random
        self.problems = self.scheduler.problems
        self.counts, self.history = Counter(), hashlib.sha256()
        arm = self.settings.devices["arm"]
        limits = limits_of(arm.limits.to_limits())
        period = 1.0 / arm.rate_hz
        self.device = EmulatedDevice(limits, period, self.tell, self.random, self.note)
        self.disk = Disk(self.scheduler)
        self.lateness = 0.0
        self.trouble = ""
        self.trouble_ns = 0
        self.servo: Process | None = None
        self.parents = {}
        self._daemon_count = 0
        self.daemon: Daemon | None = None

    # Processes

    def start_daemon(self):
        self._daemon_count += 1
        self.daemon = Daemon(self, self._daemon_count)

    def kill_daemon(self):
        self.scheduler.kill(self.daemon.group)
        killed, self.daemon = self.daemon, None
        killed.leave()

    def start_servo(self, settings, descriptor):
        process = self.servo = Process(self.scheduler, "servo")
        daemon = self.daemon
        # The arguments of another process.
        settings = replace(settings, driver="emulated_device:EmulatedDriver", options={})

        def run():
            self.parents[process.group] = daemon
            process.returncode = servo_process.run(descriptor, settings)

        self.scheduler.spawn(run, process.group, process.group)
        return process

    def pid(self):
        """Return the number of the present daemon, which no real process has."""
        return 10_000_000 + self._daemon_count

    def parent_pid(self):
        """Return ``getppid`` of a servo: 1 after the end of its daemon."""
        daemon = self.parents[self.scheduler.current().group]
        return self.pid() if daemon is self.daemon else 1

    # What a test does

    def run(self, seconds):
        """Let the time pass."""
        self.scheduler.run(self.scheduler.now_ns + round(seconds * 1e9))

    @property
    def is_calm(self):
        """Whether there is no fault, and has been none for a while."""
        return not self.trouble and self.scheduler.now_ns - self.trouble_ns > CALM_NS

    @property
    def is_moving(self):
        """Whether the device moves."""
        return self.device.judge.is_moving(self.scheduler.now_ns)

    def note(self, *happened):
        """Add to the history."""
        self.history.update(repr((self.scheduler.now_ns, *happened)).encode())

    def tell(self, problem):
        """Note a violation."""
        at = (self.scheduler.now_ns - BEGIN_NS) * 1e-9
        self.problems.append(f"seed {self.seed}, {at:.3f} s: {problem}")


class _Timer:
    """Wait for deadlines; now and then the machine is late."""

    system: System = None

    def __init__(self, spin_ns=0):
        pass

    def wait(self, deadline_ns):
        scheduler, late = self.system.scheduler, 0
        if self.system.lateness and scheduler.random.random() < 0.05:
            late = round(scheduler.random.expovariate(1.0 / self.system.lateness) * 1e9)
        scheduler.wait(deadline_ns + late)
        return scheduler.now_ns


@contextlib.contextmanager
def emulated(seed, name="slow"):
    """Give a :class:`System` that has not started, and the clock to it."""
    system = System(seed, name)

    def write_report(path, report):
        system.disk.write(path)

    def write_recording(_recorder, _file):
        system.scheduler.sleep(0.2)
        system.disk.write()
        return EventKind.RECORDED, "recorded"

    replaced = [
        *of_servos(system, _Timer),
        (os, "getpid", system.pid),
        (EmulatedDriver, "device", system.device),
        (_Timer, "system", system),
        (Path, "write_text", write_report),
        (flight_recorder.FlightRecorder, "_written", write_recording),
    ]
    with contextlib.ExitStack() as stack:
        stack.enter_context(virtual_time(system.scheduler))
        for owner, name, value in replaced:
            stack.enter_context(mock.patch.object(owner, name, value))
        yield system
