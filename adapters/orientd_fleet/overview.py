"""The newest state of every daemon of a cell, with its age on one clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import STALE
from orientd_fleet.keys import daemon_of

if TYPE_CHECKING:
    import zenoh

    from orientd_fleet.client import Fleet

FIRST = 1.0
"""How long the first state of a daemon is waited for, s."""

_PAUSE, _TRIPS = 5.0, 8
"""From one measurement of the clocks to the next, s; and the round trips of it."""


@dataclass(frozen=True, slots=True)
class Member:
    """A daemon of a cell and its devices.

    Attributes:
        daemon: its name.
        is_alive: whether it is there.
        age: of its last report, s; ``None`` if it has sent none.
        age_bound: largest error of the age, s; ``None`` if its clock is unknown.  The age then
            counts from the arrival of the report.
        devices: as that report has them.
    """

    daemon: str
    is_alive: bool
    age: float | None = None
    age_bound: float | None = None
    devices: Sequence[pb.DeviceReport] = ()

    @property
    def problem(self) -> str:
        """Why the last report is out of date; empty while it is not."""
        if not self.is_alive:
            return "has left"
        if self.age is None:
            return "says nothing"
        return "stale" if self.age > STALE else ""


class Overview:
    """All daemons of a cell and their devices, for as long as a ``with`` block."""

    def __init__(self, fleet: Fleet) -> None:
        """Look at *fleet*."""
        self._fleet = fleet
        # Of each daemon its state, and when it arrived on our clock, ns.
        self._heard: dict[str, tuple[zenoh.Sample, int]] = {}
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._measure, name="orientd clocks", daemon=True)

    def __enter__(self) -> Self:
        """Wait for the states of all daemons, as far as they come soon."""
        self._fleet.subscribe("state", self._hear)
        end = time.monotonic() + FIRST
        while set(self._fleet.daemons) - self._heard.keys() and time.monotonic() < end:
            time.sleep(0.01)
        for name in self._fleet.daemons:
            self._fleet.clock(name).measure()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    def _hear(self, sample: zenoh.Sample) -> None:
        self._heard[daemon_of(str(sample.key_expr))] = (sample, time.monotonic_ns())

    def members(self) -> list[Member]:
        """Return all daemons that are there or were, in the order of their names."""
        alive, heard = self._fleet.daemons, self._heard.copy()
        return [
            self._member(name, *heard[name], is_alive=name in alive)
            if name in heard
            else Member(name, is_alive=True)
            for name in sorted({*alive, *heard})
        ]

    def _member(self, name: str, sample: zenoh.Sample, heard_ns: int, *, is_alive: bool) -> Member:
        devices = list(pb.GetStateResponse.FromString(sample.payload.to_bytes()).devices)
        now = time.monotonic_ns()
        offset = self._fleet.clock(name).at(now)
        if offset is None or sample.attachment is None:
            return Member(name, is_alive, (now - heard_ns) * 1e-9, None, devices)
        taken_ns = int.from_bytes(sample.attachment.to_bytes(), "little")
        age = (now + offset.ns - taken_ns) * 1e-9
        return Member(name, is_alive, age, offset.bound_ns * 1e-9, devices)

    def stop(self, *, is_quickest: bool) -> str:
        """Stop every device; return which daemons have not acknowledged it and why."""
        answers = self._fleet.stop(is_quickest=is_quickest)
        return "; ".join(f"{one.daemon}: {one.problem}" for one in answers if one.problem)

    def _measure(self) -> None:
        while not self._closing.wait(_PAUSE):
            for name in self._fleet.daemons:
                if not self._closing.is_set():
                    self._fleet.clock(name).measure(_TRIPS)
