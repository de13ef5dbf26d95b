"""Processes in virtual time: each is a group of tasks."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import time
from types import SimpleNamespace

from direct_planners import DirectPlanners
from serial_lines import SerialLines

from orientd.daemon.device import EventKind, device
from orientd.daemon.device.servo_process import ServoProcess
from orientd.recorder import flight
from orientd.recorder.writer import RecordingError
from orientd.servo import process as servo_process

PLANNING = (0.002, 0.01, 0.03, 0.3)
"""Times that a plan may take, s; the seed decides."""

WRITING = 0.3
"""Time that a file of the flight recorder takes, s."""

_getpid = os.getpid


class Process:
    """A process, with the methods of :class:`subprocess.Popen` that its users call.

    Attributes:
        group: of its tasks.
        pid: a number that no real process has.
    """

    stdin = stdout = stderr = None

    def __init__(self, scheduler, kind):
        number = next(scheduler.numbers)
        self._scheduler, self._at_end = scheduler, []
        self.group, self.pid, self.returncode = f"{kind} {number}", 10_000_000 + number, None

    def at_end(self, callback):
        """Have *callback* called when it has ended, whichever way."""
        self._at_end.append(callback)

    def poll(self):
        return self.returncode

    def wait(self, timeout=None):
        ends = None if timeout is None else time.monotonic() + timeout
        while self.returncode is None:
            if ends is not None and time.monotonic() > ends:
                raise subprocess.TimeoutExpired(self.group, timeout)
            self._scheduler.sleep(0.001)
        return self.returncode

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

    def end(self, returncode):
        """End at once, with all of its tasks."""
        self.returncode = returncode
        self._scheduler.kill(self.group)
        for callback in reversed(self._at_end):
            callback()

    def _receive(self, number):
        self.end(-number)


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

    def __init__(self, settings, random):
        super().__init__(settings)
        self._random = random

    def start(self):
        pass

    async def close(self):
        pass

    async def plan(self, request, *, rank=None):
        await asyncio.sleep(self._random.choice(PLANNING))
        return await super().plan(request, rank=rank)


def written(_recorder, recorded):
    """Write a file of the flight recorder, which takes its time."""
    time.sleep(WRITING)
    try:
        with os.fdopen(os.dup(recorded.fileno()), "rb") as file:
            return EventKind.RECORDED, str(flight.write(file))
    except (RecordingError, OSError, ValueError) as error:
        return EventKind.RECORDING_FAILED, str(error)


class World:
    """The processes of a test, by their numbers and sockets.

    Attributes:
        scheduler: of their tasks.
        listeners: what answers calls, by the socket.
        pipes: by the numbers that stand for their descriptors.
        lines: serial lines.
        sockets: tasks that wait for sockets.
    """

    def __init__(self, scheduler):
        self.scheduler, self.listeners, self.pipes = scheduler, {}, {}
        self.lines, self.sockets = SerialLines(scheduler), None
        self._processes, self._parents = {}, {}

    def add(self, process):
        """Add a process, whose parent is the present one."""
        self._processes[process.pid] = self._processes[process.group] = process
        self._parents[process.group] = self.present()

    def start_servo(self, settings, descriptor):
        process = Process(self.scheduler, "servo")
        self.add(process)

        def run():
            process.end(servo_process.run(descriptor, settings))

        self.scheduler.spawn(run, process.group, process.group)
        return process

    def process(self, pid):
        """Return a process of this world, or ``None``."""
        return self._processes.get(pid)

    def present(self):
        """Return the process that runs, or ``None`` for the test."""
        task = self.scheduler.current()
        return self._processes.get(task.group) if task is not None else None

    def pid(self):
        """Return the number of the process that runs."""
        present = self.present()
        return _getpid() if present is None else present.pid

    def parent_pid(self):
        """Return ``getppid`` of a process: 1 after the end of its parent."""
        parent = self._parents[self.present().group]
        if parent is None:
            return _getpid()  # a test is there as long as what it starts
        return parent.pid if parent.returncode is None else 1

    def children(self, pid):
        """Return the numbers of the running processes that a process has started."""
        parent = self._processes[pid]
        children = {self._processes[one] for one, of in self._parents.items() if of is parent}
        return {one.pid for one in children if one.returncode is None}
