"""The newest state of every daemon of a cell, with its age on one clock."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from orientd.rpc import device_from_message
from orientd.viewer import Member

if TYPE_CHECKING:
    from typing import Self

    from orientd.fleet.client import Fleet, Heard

FIRST = 1.0
"""How long the first state of a daemon is waited for, s."""

_PAUSE, _TRIPS = 5.0, 8
"""From one measurement of the clocks to the next, s; and the round trips of it."""


class Overview:
    """Who is there and how they are, for as long as a ``with`` block."""

    def __init__(self, fleet: Fleet) -> None:
        """Look at *fleet*."""
        self._fleet = fleet
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._measure, name="orientd clocks", daemon=True)

    def __enter__(self) -> Self:
        """Wait for the states of all daemons, as far as they come soon."""
        fleet = self._fleet
        fleet.watch()
        end = time.monotonic() + FIRST
        while set(fleet.daemons) - fleet.heard().keys() and time.monotonic() < end:
            time.sleep(0.01)
        for name in fleet.daemons:
            fleet.clock(name).measure()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    def members(self) -> list[Member]:
        """Return all daemons that are there or were, in the order of their names."""
        heard, alive = self._fleet.heard(), self._fleet.daemons
        found = []
        for name in sorted({*alive, *heard}):
            if name not in heard:
                found.append(Member(name, name in alive))
                continue
            age, bound = self._age(name, heard[name])
            devices = [device_from_message(device) for device in heard[name].state.devices]
            found.append(Member(name, name in alive, age, bound, devices))
        return found

    def _age(self, name: str, heard: Heard) -> tuple[float, float | None]:
        """Return how old a state is and how far that may be wrong, s."""
        now = time.monotonic_ns()
        offset = self._fleet.clock(name).at(now)
        if offset is None:
            return (now - heard.heard_ns) * 1e-9, None
        return (now + offset.ns - heard.taken_ns) * 1e-9, offset.bound_ns * 1e-9

    def stop(self, *, is_quickest: bool) -> str:
        """Stop every device; return which daemons have not acknowledged it and why."""
        answers = self._fleet.stop(is_quickest=is_quickest)
        return "; ".join(f"{one.daemon}: {one.problem}" for one in answers if one.problem)

    def _measure(self) -> None:
        while not self._closing.wait(_PAUSE):
            for name in self._fleet.daemons:
                if not self._closing.is_set():
                    self._fleet.clock(name).measure(_TRIPS)
