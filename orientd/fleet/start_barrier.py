"""The barrier of a start: no daemon of it begins unless every one has been asked to.

Each gateway says on the network that it was asked (``ready``), and hands the motion on to its
daemon once it has heard that of all the others.  Whoever asks may die at any moment: a daemon that
was not asked never says so, and then nobody begins.  A daemon that refuses the motion then, or that
leaves before the start time, has it dropped by all the others.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

KEPT = 64
"""Starts that are remembered: the others may be asked before this one."""

NOT_READY = "not ready in time, so nothing begins"
"""How the refusal of a start ends that may go well another time."""

READY, DROPPED = b"ready", b"dropped"

Say = Callable[[str, bytes], object]
"""Tells all gateways of the cell something about a start, by its name."""


@dataclass
class _Part:
    """What this daemon is to do in a start."""

    begin: Callable[[], object]
    refuse: Callable[[str], object]
    drop: Callable[[], object]
    start_ns: int
    has_begun: bool = False


@dataclass
class _Start:
    among: frozenset[str] = frozenset()
    ready: set[str] = field(default_factory=set)
    dropped: str = ""
    parts: list[_Part] = field(default_factory=list)


class StartBarrier:
    """The starts that one daemon takes part in.  Safe to call from any thread."""

    def __init__(self, name: str, say: Say) -> None:
        """Know of no start yet.

        Args:
            name: of this daemon.
            say: tells the others.
        """
        self._name = name
        self._say = say
        self._lock = threading.RLock()
        self._starts: OrderedDict[str, _Start] = OrderedDict()

    def join(
        self,
        start: str,
        among: frozenset[str],
        *,
        parts: int,
        start_ns: int,
        until_ns: int,
        begin: Callable[[], object],
        refuse: Callable[[str], object],
        drop: Callable[[], object],
    ) -> None:
        """Take part in a start, with one motion.

        Args:
            start: names it.
            among: the daemons of it.
            parts: how many motions this daemon has in it; it is ready with the last.
            start_ns: when it is to begin, monotonic clock.
            until_ns: when all must be ready, monotonic clock.
            begin: hands the motion on to the daemon.
            refuse: says why it is not.
            drop: ends it again before it begins.
        """
        with self._lock:
            one = self._of(start)
            if one.dropped:
                refuse(one.dropped)
                return
            one.among = among
            one.parts.append(_Part(begin, refuse, drop, start_ns))
            is_ready = len(one.parts) >= parts
        if is_ready:
            self._say(start, READY)
        wait = max(0.0, (until_ns - time.monotonic_ns()) * 1e-9)
        timer = threading.Timer(wait, self._give_up, (start,))
        timer.daemon = True
        timer.start()

    def hear(self, start: str, daemon: str, what: bytes) -> None:
        """Take note of what *daemon* says of a start."""
        with self._lock:
            one = self._of(start)
            if what == DROPPED:
                self._drop(one, f"{daemon} cannot begin")
                return
            one.ready.add(daemon)
            self._go(one)

    def lose(self, daemon: str) -> None:
        """Drop the starts to come of a daemon that has left."""
        with self._lock:
            for one in self._starts.values():
                if daemon in one.among:
                    self._drop(one, f"{daemon} has left")

    def fail(self, start: str, why: str) -> None:
        """Have a start dropped by all, as far as it has not begun."""
        with self._lock:
            self._drop(self._of(start), why)
        self._say(start, DROPPED)

    # With the lock held

    def _of(self, start: str) -> _Start:
        if start not in self._starts:
            self._starts[start] = _Start()
            while len(self._starts) > KEPT:
                self._starts.popitem(last=False)
        return self._starts[start]

    def _go(self, one: _Start) -> None:
        if one.dropped or not one.among or not one.ready >= one.among:
            return
        for part in one.parts:
            if not part.has_begun:
                part.has_begun = True
                part.begin()

    def _drop(self, one: _Start, why: str) -> None:
        one.dropped = one.dropped or why
        for part in one.parts:
            if not part.has_begun:
                part.refuse(why)
            elif time.monotonic_ns() < part.start_ns:
                part.drop()
        one.parts.clear()

    def _give_up(self, start: str) -> None:
        with self._lock:
            one = self._of(start)
            if all(part.has_begun for part in one.parts):
                return
            missing = ", ".join(sorted(one.among - one.ready)) or self._name
        self.fail(start, f"{missing} was {NOT_READY}")
