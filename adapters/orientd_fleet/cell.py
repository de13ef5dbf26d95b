"""A cell of daemons as its page shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from orientd.protocol import STALE
from orientd.protocol import control_pb2 as pb


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


class Cell(Protocol):
    """The daemons that a page shows and stops."""

    def members(self) -> Sequence[Member]:
        """Return every daemon that is or was there, in the order of their names."""

    def stop(self, *, is_quickest: bool) -> str:
        """Stop every device; return the daemons that did not acknowledge it, empty if all did."""
