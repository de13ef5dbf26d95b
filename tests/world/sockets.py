"""Sockets in the world: real ones of this machine, for which tasks wait in virtual time.

What one task sends is there before another looks: both ends are in this process.
"""

from __future__ import annotations

import errno
import functools
import math
import select
import selectors
import socket
import socketserver

from virtual_time import Selector

_LOOK = 0.05
"""Interval between two looks if the kernel is late, s."""

SENDING = (0.0005, 0.003)
"""Least and most time that sending takes, s; the seed decides."""

_CONNECTING = 5.0  # s of real time


class Waiting:
    """The tasks that wait for sockets; each looks again whenever any socket has been used.

    Attributes:
        connecting: ends of connections to robots that nobody has accepted yet, by their names.
    """

    def __init__(self, scheduler):
        self._scheduler, self._tasks, self.connecting = scheduler, [], {}

    def wait(self, until_ns):
        """Wait for the next use of a socket; return whether there is time left."""
        scheduler = self._scheduler
        now, task = scheduler.now_ns, scheduler.current()
        if until_ns is not None and now >= until_ns:
            return False
        look = now + round(_LOOK * 1e9)
        self._tasks.append(task)
        try:
            scheduler.wait(look if until_ns is None else min(look, until_ns))
        finally:
            self._tasks.remove(task)
        return True

    def wake(self):
        for task in self._tasks:
            self._scheduler.wake(task)

    def end(self, seconds):
        """Return when so many seconds from now are over."""
        if seconds is None:
            return None
        return self._scheduler.now_ns + math.ceil(max(0.0, seconds) * 1e9)


def _waiting(name):
    """Return a method that waits until it would not block."""
    really = getattr(socket.socket, name)
    return lambda self, *given: self._await(functools.partial(really, self), *given)


class _PatientSocket(socket.socket):
    """A socket whose timeout is in virtual time; it never blocks."""

    world = None
    _seconds = None

    def settimeout(self, seconds):
        self._seconds = seconds

    def setblocking(self, is_blocking):
        self._seconds = None if is_blocking else 0.0

    def gettimeout(self):
        return self._seconds

    def getblocking(self):
        return self._seconds != 0.0

    def _block(self, seconds):
        """Let the kernel block for so many seconds of real time."""
        super().settimeout(seconds)

    def _await(self, work, *given):
        """Do what would block as soon as it does not."""
        waiting = self.world.sockets
        until_ns = waiting.end(self._seconds)
        while True:
            try:
                result = work(*given)
            except BlockingIOError:
                if self._seconds == 0.0:
                    raise
                if not waiting.wait(until_ns):
                    raise TimeoutError("timed out") from None
            else:
                waiting.wake()
                return result


class VirtualSocket(_PatientSocket):
    """A socket; what would block waits in virtual time."""

    def __init__(self, family=-1, type=-1, proto=-1, fileno=None):  # noqa: A002 - as it is called
        super().__init__(family, type, proto, fileno)
        is_at_once = type != -1 and type & socket.SOCK_NONBLOCK
        self._seconds = 0.0 if is_at_once else socket.getdefaulttimeout()
        self._block(0.0)
        present = self.world.present()
        if present is not None:
            present.at_end(self.close)

    accept, recv, recv_into, recvfrom, recvmsg = map(
        _waiting, ("accept", "recv", "recv_into", "recvfrom", "recvmsg")
    )

    def send(self, *given):
        self._spend()
        return self._await(super().send, *given)

    def sendto(self, *given):
        self._spend()
        return self._await(super().sendto, *given)

    def _spend(self):
        """Spend the time that sending takes, or two who talk without a pause stop the clock."""
        if self._seconds != 0.0:
            self.world.scheduler.sleep(self.world.scheduler.random.uniform(*SENDING))

    def sendall(self, content, *flags):
        view = memoryview(content).cast("B")
        while view:
            view = view[self.send(view, *flags) :]

    def connect(self, address):
        # On one machine the kernel connects at once.
        self._block(_CONNECTING)
        try:
            super().connect(address)
        finally:
            self._block(0.0)
        self.world.sockets.wake()

    def connect_ex(self, address):
        try:
            self.connect(address)
        except OSError as error:
            return error.errno or errno.ECONNREFUSED
        return 0

    def shutdown(self, how):
        super().shutdown(how)
        self.world.sockets.wake()

    def close(self):
        super().close()
        # A connection that nobody closed is closed as garbage, maybe after the world has ended.
        if self.world is not None:
            self.world.sockets.wake()


class VirtualSelector(selectors.PollSelector):
    """Wait for sockets in virtual time."""

    world = None

    def select(self, timeout=None):
        waiting = self.world.sockets
        until_ns = waiting.end(timeout)
        while not (ready := super().select(0)) and waiting.wait(until_ns):
            pass
        return ready


def _ready(pipes, *wanted):
    """Return which of three lists are ready, as ``select`` does; their numbers may be large.

    *pipes* of the world, by their numbers, may be among what is to be read.
    """
    poll, results = select.poll(), []
    for ones, event in zip(wanted, (select.POLLIN, select.POLLOUT, select.POLLPRI), strict=True):
        numbers = [one if isinstance(one, int) else one.fileno() for one in ones]
        real = set(numbers).difference(pipes)
        for number in real:
            poll.register(number, event)
        found = {number for number, _ in poll.poll(0)}
        found.update(number for number in numbers if number in pipes and pipes[number].is_ready)
        results.append([one for one, number in zip(ones, numbers, strict=True) if number in found])
        for number in real:
            poll.unregister(number)
    return tuple(results)


def of_sockets(world):
    """Return what sockets find in a world: owners, names and values to replace."""
    world.sockets = Waiting(world.scheduler)

    def selected(reading, writing, failing, timeout=None):
        until_ns = world.sockets.end(timeout)
        while True:
            ready = _ready(world.pipes, reading, writing, failing)
            if any(ready) or not world.sockets.wait(until_ns):
                return ready

    return [
        (VirtualSocket, "world", world),
        (VirtualSelector, "world", world),
        (Selector, "sockets", world.sockets),
        (socket, "socket", VirtualSocket),
        (select, "select", selected),
        (socketserver, "_ServerSelector", VirtualSelector),
        (selectors, "DefaultSelector", VirtualSelector),
    ]
