"""Processes in virtual time: a daemon or a servo is a group of tasks."""

from __future__ import annotations

import asyncio
import getpass
import itertools
import os
import signal
import subprocess
import time
from types import SimpleNamespace

import grpc
from channel import CallError
from direct_planners import DirectPlanners
from serial_lines import SerialLines
from virtual_time import VirtualLoop

from orientd import config
from orientd.clock import MonotonicClock
from orientd.config import Role
from orientd.daemon import server
from orientd.daemon.access.identity import Caller, Identity
from orientd.daemon.calls.service import Service
from orientd.daemon.device import EventKind, device
from orientd.daemon.device.servo_process import ServoProcess
from orientd.daemon.devices import Devices
from orientd.daemon.workers import Threads
from orientd.recorder import flight
from orientd.recorder.writer import RecordingError
from orientd.servo import process as servo_process

PLANNING = (0.002, 0.01, 0.03, 0.3)
"""Times that a plan may take, s, the last on a busy machine only; the seed decides."""

WRITING = 0.3
"""Time that a file of the flight recorder takes, s."""

_NUMBERS = itertools.count(1)


class Process:
    """A process, with the methods of :class:`subprocess.Popen` that its users call.

    Attributes:
        group: of its tasks.
        pid: a number that no real process has.
    """

    stdin = stdout = stderr = log = None

    def __init__(self, scheduler, kind):
        number = next(_NUMBERS)
        self._scheduler = scheduler
        self.group, self.pid, self.returncode = f"{kind} {number}", 10_000_000 + number, None

    def poll(self):
        return self.returncode

    def wait(self, timeout=None):
        ends = None if timeout is None else time.monotonic() + timeout
        while self.returncode is None:
            if ends is not None and time.monotonic() > ends:
                raise subprocess.TimeoutExpired(self.group, timeout)
            self._scheduler.sleep(0.001)
        return self.returncode

    def communicate(self, *_, timeout=None):
        self.wait(timeout)
        return "", ""

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def send_signal(self, number):
        if self.returncode is not None:
            return
        if number == signal.SIGCONT:
            self._scheduler.thaw(self.group)
        elif number == signal.SIGSTOP:
            self._scheduler.freeze(self.group)
        else:
            self._receive(number)

    def _receive(self, number):
        self._scheduler.kill(self.group)
        self.returncode = -number


class Servo(ServoProcess):
    """The daemon's part of a servo process, which runs in tasks of this process."""

    world = None

    def _begin(self, settings, descriptor):
        return self.world.start_servo(settings, os.dup(descriptor))

    def _is_stopped(self, process):
        return self.world.scheduler.is_frozen(process.group)


def of_servos(world, timer):
    """Return what servo processes find in a world: owners, names and values to replace.

    Args:
        world: starts servo processes, and knows their parents.
        timer: the class that waits for deadlines.
    """
    signals = SimpleNamespace(
        signal=lambda *_: None, SIGINT=2, SIGTERM=15, SIGTTOU=22, SIG_IGN=None
    )
    return [
        (Servo, "world", world),
        (device, "ServoProcess", Servo),
        (servo_process, "DeadlineTimer", timer),
        (servo_process, "os", SimpleNamespace(getppid=world.parent_pid)),
        (servo_process, "signal", signals),
        (servo_process, "lock_memory", lambda: True),
        (servo_process, "set_scheduling", lambda _priority: "virtual"),
        (servo_process, "freeze_garbage", lambda: None),
    ]


class Planners(DirectPlanners):
    """Planners that take a moment."""

    timeout = 60.0

    def __init__(self, settings, random, times=PLANNING):
        super().__init__(settings)
        self._random, self._times = random, times

    def start(self):
        pass

    async def close(self):
        pass

    async def plan(self, plan_input, call, *, rank=None):
        await asyncio.sleep(self._random.choice(self._times))
        return await super().plan(plan_input, call, rank=rank)


def written(_recorder, recorded):
    """Write a file of the flight recorder, which takes its time."""
    time.sleep(WRITING)
    try:
        with os.fdopen(os.dup(recorded.fileno()), "rb") as given:
            return EventKind.RECORDED, str(flight.write(given))
    except (RecordingError, OSError, ValueError) as error:
        return EventKind.RECORDING_FAILED, str(error)


class Daemon(Process):
    """One run of the daemon: its service and its loop.

    Attributes:
        is_serving: whether it answers calls.
        calls: those that run.
        caller: who calls it.
    """

    def __init__(self, world, path, socket):
        super().__init__(world.scheduler, "daemon")
        self._settings, self._socket = config.load(path), socket
        self.loop = VirtualLoop(world.scheduler)
        self.is_serving, self.calls = False, set()
        user = f"user:{os.getuid()}"
        identity = Identity(user, getpass.getuser(), Role.ADMINISTRATOR)
        self.caller = Caller(SimpleNamespace(), "unix", identity)
        self._ending = None
        world.scheduler.spawn(self._run, "daemon", self.group)

    def _run(self):
        self.loop.run_until_complete(self._serve())
        self.loop.close()
        self.returncode = 0

    async def _serve(self):
        settings, life = self._settings, Threads(1, "life")
        self._ending = asyncio.Event()
        planners = Planners(settings.devices.values(), self._scheduler.random, PLANNING[:3])
        devices = Devices(settings, planners=planners, clock=MonotonicClock())
        self.service = Service(
            devices,
            keyframes=settings.access.keyframes,
            socket=self._socket,
            configuration="",
            began=time.monotonic(),
        )
        await life.run(devices.launch)
        expiring = asyncio.create_task(server._expire_leases(devices))
        await life.run(devices.wait_ready, server.READY_TIMEOUT)
        self.is_serving = True
        await self._ending.wait()
        expiring.cancel()
        await life.run(devices.shutdown)
        self.service.end_calls()
        await asyncio.sleep(server.GRACE)
        self._leave()
        life.close()
        devices.close()

    def _receive(self, number):
        if number in (signal.SIGTERM, signal.SIGINT):
            self.loop.call_soon_threadsafe(self._ending.set)
            return
        super()._receive(number)
        self.loop.abandon()
        self._leave()

    def _leave(self):
        """Let every caller know that it has gone."""
        self.is_serving = False
        for call in list(self.calls):
            call.end(CallError(grpc.StatusCode.UNAVAILABLE, "Socket closed"))


class World:
    """The processes of a test, by their numbers and sockets.

    Attributes:
        scheduler: of their tasks.
        environment: variables of their environment.
        lines: serial lines.
    """

    def __init__(self, scheduler):
        self.scheduler, self.lines = scheduler, SerialLines(scheduler)
        self._daemons, self._processes, self._parents, self.environment = {}, {}, {}, {}

    def start_daemon(self, path, socket):
        daemon = self._daemons[str(socket)] = Daemon(self, path, socket)
        self._processes[daemon.pid] = daemon
        return daemon

    def start_servo(self, settings, descriptor):
        process, parent = Process(self.scheduler, "servo"), self.scheduler.current().group
        self._processes[process.pid] = process
        self._parents[process.group] = parent

        def run():
            process.returncode = servo_process.run(descriptor, settings)

        self.scheduler.spawn(run, process.group, process.group)
        return process

    def daemon_at(self, socket):
        """Return the daemon that answers at a socket, or ``None``."""
        daemon = self._daemons.get(str(socket))
        return daemon if daemon is not None and daemon.is_serving else None

    def log_of(self, group):
        """Return the log of the daemon whose tasks are a group, or ``None``."""
        return next((one.log for one in self._daemons.values() if one.group == group), None)

    def process(self, pid):
        """Return a process of this world, or ``None``."""
        return self._processes.get(pid)

    def parent_pid(self):
        """Return ``getppid`` of a servo: 1 after the end of its daemon."""
        parent = self._parents[self.scheduler.current().group]
        is_there = any(
            one.group == parent and one.returncode is None for one in self._daemons.values()
        )
        return os.getpid() if is_there else 1
