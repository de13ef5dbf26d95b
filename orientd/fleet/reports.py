"""What a cell's daemons say of themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from orientd.rpc import control_pb2 as pb


@dataclass(frozen=True, slots=True)
class Stopped:
    """What a daemon says of a stop.

    Attributes:
        daemon: its name.
        devices: of each ``name``, ``state`` and ``motion`` as the stop met them.
        seconds: from the call until its answer was here.
        taken_after: from the call until its servos had taken the stop, by its clock and what is
            known of that, s; ``None`` where nothing is.
        problem: why it is not known to have stopped; empty if it is.
    """

    daemon: str
    devices: Sequence[dict[str, Any]]
    seconds: float
    taken_after: float | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Heard:
    """The newest state of a daemon.

    Attributes:
        state: as the daemon tells it.
        taken_ns: when, on the daemon's monotonic clock.
        heard_ns: when it was here, on ours.
    """

    state: pb.GetStateResponse
    taken_ns: int
    heard_ns: int
