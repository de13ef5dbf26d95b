"""Tests of processes, run in one process in virtual time.

A module with the marker ``world`` runs here: its daemons, servos and clients are tasks of one
scheduler, with one clock and one seed.  The code under test does not change.  With ``--real`` the
same functions run with real processes and sockets.
"""

from __future__ import annotations

import contextlib
import functools
import os
import threading
from unittest import mock

import harness
from _pytest.runner import runtestprotocol
from channel import Channel
from logs import logs
from processes import World, of_servos, written
from serial_lines import of_serial_lines
from virtual_time import Scheduler, VirtualThread, virtual_time

from orientd.client.channel import Way
from orientd.daemon.observe import flight_recorder

STEP_NS = 50_000_000
LONGEST = 200.0
"""Virtual time of a test without a mark ``timeout``, s."""


class _Timer:
    """Wait for the deadlines of a servo."""

    scheduler = None

    def __init__(self, spin_ns=0):
        pass

    def wait(self, deadline_ns):
        self.scheduler.wait(deadline_ns)
        return self.scheduler.now_ns


class _ThreadTimer(VirtualThread):
    """``threading.Timer``, as a task."""

    def __init__(self, interval, function, args=None, kwargs=None):
        self._is_cancelled = False

        def wait():
            self.scheduler.sleep(max(0.0, interval))
            if not self._is_cancelled:
                function(*(args or ()), **(kwargs or {}))

        super().__init__(target=wait, name="timer")

    def cancel(self):
        self._is_cancelled = True


class Machine(harness.Machine):
    """What tests reach processes by, in virtual time."""

    def __init__(self, world):
        self._world = world

    def start_daemon(self, it):
        self._world.environment["XDG_STATE_HOME"] = str(it.folder / "state")
        os.environ.update(self._world.environment)
        process = self._world.start_daemon(it.config, it.socket)
        process.log = it.log
        while not process.is_serving:
            self._world.scheduler.sleep(0.01)
        return process

    def channel(self, socket):
        return Channel(self._world, socket)

    def is_alive(self, pid):
        process = self._world.process(pid)
        return process.poll() is None if process else super().is_alive(pid)

    def kill(self, pid, number):
        process = self._world.process(pid)
        if process is None:
            super().kill(pid, number)
        else:
            process.send_signal(number)


@contextlib.contextmanager
def running(world):
    """Replace transport, processes and clock within the context."""
    scheduler = world.scheduler
    machine = Machine(world)
    replaced = [
        (harness, "MACHINE", machine),
        (os, "kill", machine.kill),
        (threading, "Timer", _ThreadTimer),
        (Way, "open", lambda way: Channel(world, way.socket)),
        (flight_recorder.FlightRecorder, "_made", written),
        (_Timer, "scheduler", scheduler),
        *of_servos(world, _Timer),
        *of_serial_lines(world.lines),
    ]
    with virtual_time(scheduler), logs(world), contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.dict(os.environ, world.environment))
        for owner, name, value in replaced:
            stack.enter_context(mock.patch.object(owner, name, value))
        yield


def longest_of(item):
    """Return the virtual time that a test may take, s."""
    mark = item.get_closest_marker("timeout")
    return LONGEST if mark is None else max(LONGEST, mark.args[0])


class VirtualRunner:
    """Run tests as tasks of a world; those of a module share one."""

    def __init__(self, seed):
        self._seed, self._world, self._module = seed, None, ""

    def run(self, item, nextitem):
        """Run a test with its fixtures."""
        module = item.location[0]
        if self._world is None or module != self._module:
            self._world, self._module = World(Scheduler(f"{self._seed} {module}")), module
        scheduler = self._world.scheduler
        with running(self._world):
            longest_ns = round(longest_of(item) * 1e9)
            ends_ns = scheduler.now_ns + longest_ns
            work = functools.partial(runtestprotocol, item, nextitem=nextitem)
            task = scheduler.spawn(work, item.nodeid, "test")
            while not task.is_over:
                if not scheduler.is_busy or scheduler.now_ns > ends_ns:
                    scheduler.fail(task, "nothing happens any more")
                    ends_ns += longest_ns
                scheduler.run(scheduler.now_ns + STEP_NS)
        if nextitem is None:
            self._world = None
        if scheduler.problems:
            raise AssertionError("\n".join(scheduler.problems))
