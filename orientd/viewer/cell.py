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
        age: how old what is known of it is, s; ``None`` where nothing is.
        age_bound: how far that may be wrong, s; ``None`` where its clock is not known: then the age
            is since it was heard.
        devices: as they were then.
    """

    daemon: str
    is_alive: bool
    age: float | None = None
    age_bound: float | None = None
    devices: Sequence[pb.DeviceReport] = ()

    @property
    def problem(self) -> str:
        """Why what is known is not how things are; empty if nothing."""
        if not self.is_alive:
            return "has left"
        if self.age is None:
            return "says nothing"
        return "stale" if self.age > STALE else ""


class Cell(Protocol):
    """What a page needs of a cell."""

    def members(self) -> Sequence[Member]:
        """Return all that there are or were, in the order of their names."""

    def stop(self, *, is_quickest: bool) -> str:
        """Stop every device; return what is not known to have stopped, empty if nothing."""
