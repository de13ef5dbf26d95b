"""What others are told of a lease."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LeaseReport:
    """A lease, to those who do not hold it.

    Attributes:
        holder: who holds it, as they named themselves; empty when it is free.
        remaining: how long it lasts unless renewed, s.
        identity: whose it is as the daemon knows them, for example ``user:1000``.
        devices: that it is of.
    """

    holder: str
    remaining: float
    identity: str = ""
    devices: tuple[str, ...] = ()
