"""Tests of processes, run in one process in virtual time.

A module with the marker ``world`` runs here: its daemons, servos and clients are tasks of one
scheduler, with one clock and one seed.  The code under test does not change.  With ``--real`` the
same functions run with real processes and sockets.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import resource
import threading
from unittest import mock

import harness
from _pytest.runner import CallInfo, runtestprotocol
from arms import of_robots
from channel import Channel, VirtualListener
from judged_drivers import of_judges
from planners import of_planners
from processes import World, of_servos, written
from programs import of_programs
from serial_lines import of_serial_lines
from sockets import of_sockets
from stop_sockets import of_stop_sockets
from virtual_time import Scheduler, VirtualThread, virtual_time

from orientd.client.channel import Way
from orientd.daemon import server
from orientd.daemon.access.identity import look_up
from orientd.daemon.observe import flight_recorder

_KILL = os.kill

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

    is_patient = False

    def __init__(self, world):
        self._world = world

    def run_first(self, pid):
        pass

    def channel(self, socket):
        return Channel(self._world, socket)

    def is_alive(self, pid):
        process = self._world.process(pid)
        return process.poll() is None if process else super().is_alive(pid)

    def children(self, pid):
        return self._world.children(pid)

    def kill(self, pid, number):
        process = self._world.process(pid)
        if process is None:
            _KILL(pid, number)
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
        (VirtualListener, "world", world),
        (server, "Listener", VirtualListener),
        *of_servos(world, _Timer),
        *of_stop_sockets(world),
        *of_planners(world),
        *of_programs(world),
        *of_serial_lines(world.lines),
        *of_robots(world),
        *of_judges(scheduler),
        *of_sockets(world),
    ]
    look_up(os.geteuid()).result()  # threads of its own find the names of users
    level = logging.root.level
    with virtual_time(scheduler), contextlib.ExitStack() as stack:
        stack.callback(logging.root.setLevel, level)
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
        # What a killed process of a world had open stays open here.
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))

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
            report_problems(item, scheduler.problems)


def report_problems(item, problems):
    """Report what tasks ended by, and what a judge found, as an error of the test."""

    def fail():
        raise AssertionError("\n".join(problems))

    call = CallInfo.from_call(fail, "teardown")
    report = item.ihook.pytest_runtest_makereport(item=item, call=call)
    item.ihook.pytest_runtest_logreport(report=report)
    problems.clear()
