"""One clock and one seed for threads, processes and event loops, each of which is a greenlet.

A task runs until it waits: in ``time.sleep``, for a lock, an event or a queue of ``threading``, or
in the ``select`` of an event loop.  Then the task that is due next runs.  The seed decides between
tasks that are due at the same instant.  Calculation takes no time.  The code under test does not
change: :func:`virtual_time` replaces the primitives of which all the others are made.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import heapq
import itertools
import logging
import math
import os
import queue
import random
import secrets
import selectors
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections import deque
from pathlib import Path
from unittest import mock

from greenlet import getcurrent, greenlet

from orientd.clock import MonotonicClock

BEGIN_NS = 10**12

COLLECT_NS = 10 * 10**9
"""Virtual time from one collection of garbage to the next."""


class Task:
    """A task: a thread, or a process with one thread."""

    daemon = False

    def __init__(self, scheduler, work, name, group):
        self.name, self.group = name, group
        self.greenlet = greenlet(self._run, parent=scheduler.hub)
        self.scheduler, self._work = scheduler, work
        self.turn = 0
        self.is_over = False
        self.joining = []
        self.signals = deque()
        self.ident = id(self)

    def _run(self, _woken):
        try:
            self._work()
        except BaseException:  # noqa: BLE001 - whatever it is, the test fails by it
            self.scheduler.problems.append(f"{self.name}: {traceback.format_exc()}")
        self.is_over = True
        for other in self.joining:
            self.scheduler.wake(other)


class Scheduler:
    """Run tasks in virtual time.

    Attributes:
        now_ns: the time.
        wall_ns: by how much the wall clock is ahead of it.
        random: decides whatever is left open.
        problems: what a task ended by that was no orderly end.
        preemption: how likely a task is to wait before it takes a lock that is free.
        own: of a group, exchanges what its process has for itself; called before and after its
            tasks run.
        numbers: of processes.
        collected_ns: when garbage was collected last; ``None`` before the first task runs.
    """

    def __init__(self, seed):
        self.now_ns = BEGIN_NS
        self.wall_ns = 1_700_000_000 * 10**9
        self.random = random.Random(seed)
        self.problems = []
        self.preemption = 0.0
        self.hub = getcurrent()
        self.own = {}
        self.collected_ns = None
        self._due = []
        self._count, self.numbers = itertools.count(), itertools.count(1)
        self._of = {}
        self._frozen = {}
        self._buried = []

    def spawn(self, work, name, group=None):
        """Start *work* as a task, in the group of the present task by default."""
        present = self.current()
        task = Task(self, work, name, group or (present.group if present else "world"))
        self._of[task.greenlet] = task
        self._put(task, self.now_ns, woken=False)
        return task

    def current(self):
        return self._of.get(getcurrent())

    def main(self):
        """Return the task that the present process began with."""
        group = self.current().group
        return next(task for task in self._of.values() if task.group == group)

    def _put(self, task, at_ns, *, woken):
        entry = (at_ns, self.random.random(), next(self._count), task, task.turn, woken)
        heapq.heappush(self._due, entry)

    def wait(self, until_ns=None):
        """Let others run until an instant; return whether :meth:`wake` came before it."""
        task = self.current()
        if task is None:
            raise RuntimeError("only a task can wait")
        if until_ns is not None:
            self._put(task, max(until_ns, self.now_ns), woken=False)
        # Its loop is that of this thread, which all tasks share; so is what marks its generators.
        loop, hooks = asyncio._get_running_loop(), sys.get_asyncgen_hooks()
        if loop is not None:
            asyncio._set_running_loop(None)
            sys.set_asyncgen_hooks(None, None)
        is_woken = self.hub.switch()
        if loop is not None:
            asyncio._set_running_loop(loop)
            sys.set_asyncgen_hooks(*hooks)
        while task.signals:
            task.signals.popleft()()
        return is_woken

    def sleep(self, seconds):
        until_ns = self.now_ns + max(0, math.ceil(seconds * 1e9))
        while self.wait(until_ns):
            pass  # an earlier wait has woken it

    def give_way(self):
        """Let others run first, now and then, as a thread does whose time is over."""
        if self.current() is not None and self.random.random() < self.preemption:
            self.sleep(self.random.choice((0.0, 0.0, 0.001, 0.02)))

    def wake(self, task):
        """End the wait of *task* at this instant."""
        self._put(task, self.now_ns, woken=True)

    def interrupt(self, task, handle):
        """Have *task* call *handle* before anything else, as Python handles a signal."""
        task.signals.append(handle)
        self.wake(task)

    def freeze(self, group):
        """Stop a process, as SIGSTOP does."""
        self._frozen.setdefault(group, [])

    def thaw(self, group):
        for entry in self._frozen.pop(group, []):
            heapq.heappush(self._due, (max(entry[0], self.now_ns), *entry[1:]))

    def is_frozen(self, group):
        return group in self._frozen

    def lives(self, group):
        """Return whether a process has a task left."""
        return any(task.group == group for task in self._of.values())

    def kill(self, group):
        """Kill a process at once; none of its tasks runs any more."""
        self.thaw(group)
        for task in [one for one in self._of.values() if one.group == group]:
            del self._of[task.greenlet]
            task.is_over = True
            task.turn += 1
            self._buried.append(task)  # a greenlet that is collected would run its `finally`
            for other in task.joining:
                self.wake(other)

    @property
    def is_busy(self):
        """Whether a task is due at some time."""
        return bool(self._due)

    def stacks(self):
        """Return where every task waits, to find one that does not end."""
        lines = []
        for task in self._of.values():
            lines.append(f"{task.group}: {task.name}\n")
            lines += traceback.format_stack(task.greenlet.gr_frame)
        return "".join(lines)

    def fail(self, task, problem):
        """End the wait of a task by an exception."""
        task.turn += 1
        task.greenlet.throw(AssertionError(f"{problem}; the tasks wait at\n{self.stacks()}"))
        if task.is_over:
            self._of.pop(task.greenlet, None)

    def run(self, until_ns):
        """Run the due tasks until an instant, or until none is due."""
        while self._due and self._due[0][0] <= until_ns:
            entry = heapq.heappop(self._due)
            at_ns, _, _, task, turn, woken = entry
            if turn != task.turn or task.is_over:
                continue  # it has been woken since, or killed
            if task.group in self._frozen:
                self._frozen[task.group].append(entry)
                continue
            self.now_ns = max(self.now_ns, at_ns)
            self._collect()
            task.turn += 1
            exchange = self.own.get(task.group, _nothing)
            exchange()
            task.greenlet.switch(woken)
            exchange()
            if task.is_over:
                self._of.pop(task.greenlet, None)
        self.now_ns = max(self.now_ns, until_ns)

    def _collect(self):
        if self.collected_ns is not None and self.now_ns - self.collected_ns >= COLLECT_NS:
            self.collected_ns = self.now_ns
            gc.collect()


def _nothing():
    pass


class VirtualLock:
    """``threading.Lock``, for tasks."""

    def __init__(self, scheduler):
        self._scheduler, self._is_locked, self._waiting = scheduler, False, deque()

    def acquire(self, blocking=True, timeout=-1):
        scheduler = self._scheduler
        if blocking:
            scheduler.give_way()
        until_ns = None if timeout < 0 else scheduler.now_ns + math.ceil(timeout * 1e9)
        while self._is_locked:
            if not blocking or (until_ns is not None and scheduler.now_ns >= until_ns):
                return False
            task = scheduler.current()
            self._waiting.append(task)
            try:
                scheduler.wait(until_ns)
            finally:
                self._waiting.remove(task)
        self._is_locked = True
        return True

    def release(self):
        if not self._is_locked:
            raise RuntimeError("release unlocked lock")
        self._is_locked = False
        # A waiting task that is dead or stopped must not block the others.
        for task in self._waiting:
            self._scheduler.wake(task)

    def locked(self):
        return self._is_locked

    def __enter__(self):
        return self.acquire()

    def __exit__(self, *_):
        self.release()


class VirtualThread:
    """``threading.Thread``, as a task."""

    scheduler = None

    def __init__(self, group=None, target=None, name="", args=(), kwargs=None, *, daemon=None):
        self.name, self.daemon, self._task = name, daemon, None
        self._work = lambda: target(*args, **(kwargs or {}))

    def start(self):
        self._task = self.scheduler.spawn(self._work, self.name)

    def is_alive(self):
        return self._task is not None and not self._task.is_over

    def join(self, timeout=None):
        scheduler = self.scheduler
        present = None if scheduler is None else scheduler.current()
        if present is None:
            return  # the interpreter ends, long after the tasks
        until_ns = None if timeout is None else scheduler.now_ns + math.ceil(timeout * 1e9)
        self._task.joining.append(present)
        while self.is_alive() and (until_ns is None or scheduler.now_ns < until_ns):
            scheduler.wait(until_ns)


class Selector(selectors.PollSelector):
    """The selector of an event loop.

    Attributes:
        sockets: tasks that wait for sockets.
    """

    sockets = None

    def __init__(self, scheduler):
        super().__init__()
        self._scheduler, self._task, self._is_woken = scheduler, None, False

    def select(self, timeout=None):
        scheduler = self._scheduler
        until_ns = None if timeout is None else scheduler.now_ns + math.ceil(timeout * 1e9)
        while True:
            ready = super().select(0) if self.get_map() else []
            if ready or self._is_woken or (until_ns is not None and scheduler.now_ns >= until_ns):
                break
            self._wait(until_ns)
        self._is_woken = False
        return ready

    def _wait(self, until_ns):
        self._task = self._scheduler.current()
        try:
            if self.get_map():
                self.sockets.wait(until_ns)
            else:
                self._scheduler.wait(until_ns)
        finally:
            self._task = None

    def wake(self):
        self._is_woken = True
        if self._task is not None:
            self._scheduler.wake(self._task)


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time."""

    def __init__(self, scheduler):
        self._scheduler = scheduler
        super().__init__(Selector(scheduler))

    def time(self):
        return self._scheduler.now_ns * 1e-9

    def abandon(self):
        """Close the loop of a process that was killed."""
        self._thread_id = None
        self.close()

    def add_signal_handler(self, number, callback, *given):
        signal.signal(number, lambda *_: self.call_soon_threadsafe(callback, *given))

    def remove_signal_handler(self, number):
        signal.signal(number, signal.SIG_DFL)

    def _make_self_pipe(self):
        pass

    def _close_self_pipe(self):
        pass

    def _write_to_self(self):
        if self._selector is not None:
            self._selector.wake()


@contextlib.contextmanager
def _collecting(scheduler):
    """Collect garbage at instants of virtual time only.

    The interpreter collects it when enough objects have been made, and the seed does not say when
    that is.  An unfinished generator that is collected wakes its event loop.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    if scheduler.collected_ns is None:
        # A collection looks only at what the tasks make, so it is quick.
        gc.unfreeze()
        gc.freeze()
        scheduler.collected_ns = scheduler.now_ns
    try:
        yield
    finally:
        gc.collect()
        if was_enabled:
            gc.enable()


@contextlib.contextmanager
def virtual_time(scheduler):
    """Make threads, locks, clocks and random bytes those of *scheduler*."""

    def monotonic():
        return scheduler.now_ns * 1e-9

    def monotonic_ns():
        return scheduler.now_ns

    def identity():
        return id(scheduler.current())

    def lock():
        return VirtualLock(scheduler)

    replaced = [
        (time, "monotonic", monotonic),
        (time, "monotonic_ns", monotonic_ns),
        (time, "time", lambda: (scheduler.now_ns + scheduler.wall_ns) * 1e-9),
        (time, "time_ns", lambda: scheduler.now_ns + scheduler.wall_ns),
        (time, "sleep", scheduler.sleep),
        (MonotonicClock, "now_ns", staticmethod(monotonic_ns)),
        (threading, "_time", monotonic),
        (threading, "_allocate_lock", lock),
        (threading, "Lock", lock),
        (threading, "RLock", threading._PyRLock),
        (threading, "get_ident", identity),
        (threading, "current_thread", scheduler.current),
        (threading, "main_thread", scheduler.main),
        (threading, "Thread", VirtualThread),
        (queue, "time", monotonic),
        (queue, "SimpleQueue", queue._PySimpleQueue),
        (asyncio.events, "new_event_loop", lambda: VirtualLoop(scheduler)),
        (logging, "logThreads", False),
        (os, "urandom", scheduler.random.randbytes),
        (secrets, "token_hex", lambda count: scheduler.random.randbytes(count).hex()),
        (VirtualThread, "scheduler", scheduler),
    ]
    with contextlib.ExitStack() as stack, _collecting(scheduler):
        for owner, name, value in replaced:
            stack.enter_context(mock.patch.object(owner, name, value))
        for module in ("journal", "flight_recorder"):
            of = f"orientd.daemon.observe.{module}.SimpleQueue"
            stack.enter_context(mock.patch(of, queue._PySimpleQueue))
        yield


def other_process(function, *arguments, hashes, garbage):
    """Start a process that prints what a function of the tests returns.

    Args:
        function: of a module in a folder of ``sys.path``.
        arguments: of the function; their ``repr`` makes them again.
        hashes: decides the order of sets, as ``PYTHONHASHSEED``.
        garbage: how many new objects let the interpreter look for garbage.
    """
    name, module = function.__name__, Path(function.__code__.co_filename).stem
    lines = (
        f"import gc; gc.set_threshold({garbage})",
        "from pathlib import PosixPath",
        f"from {module} import {name}",
        f"print({name}(*{arguments!r}))",
    )
    own = {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": str(hashes)}
    return subprocess.Popen(
        [sys.executable, "-c", "\n".join(lines)],
        env={**os.environ, **own},
        stdout=subprocess.PIPE,
        text=True,
    )
