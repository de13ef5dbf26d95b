"""The options of a move: how a motion is to begin and to end."""

from __future__ import annotations

import time
from dataclasses import dataclass

from orientd.daemon.motions.queued_motion import SplicePoint
from orientd.daemon.planners import PlannedMotion
from orientd.errors import RequestError, StateError
from orientd.stream import UNKNOWN


@dataclass(frozen=True, slots=True)
class ArrivalCondition:
    """When a motion counts as having arrived: by what is measured, not by what was sent.

    Attributes:
        tolerance: largest angle to the target, rad.
        rate: largest angular velocity, rad/s.
        settle_time: how long both must hold without a break, s.
        timeout: how long to wait for that after the last setpoint, s.

    Raises:
        RequestError: one of them is not a positive number.
    """

    tolerance: float
    rate: float
    settle_time: float
    timeout: float

    def __post_init__(self) -> None:
        for name in ("tolerance", "rate", "settle_time", "timeout"):
            number = getattr(self, name)
            if not 0.0 < number < float("inf"):
                raise RequestError(f"on_target.{name}", f"expected more than 0, got {number!r}")


@dataclass(frozen=True, slots=True)
class MoveOptions:
    """How a motion is to begin and to end.

    Attributes:
        is_queued: whether it follows what runs; otherwise it replaces that.
        blend: how far from the corner to what runs before it may pass, rad; 0 joins them there.
        start_ns: when it is to begin, monotonic clock; :data:`~orientd.stream.UNKNOWN` for at once.
        gate: when it has arrived; ``None`` for when its last setpoint is sent.
    """

    is_queued: bool = False
    blend: float = 0.0
    start_ns: int = UNKNOWN
    gate: ArrivalCondition | None = None

    def check_start_time(self) -> None:
        """Refuse a start time that has passed.

        Raises:
            StateError: it has.
        """
        late = (time.monotonic_ns() - self.start_ns) * 1e-9
        if self.start_ns != UNKNOWN and late > 0.0:
            raise StateError(f"the motion was ready {late:.3f} s after its start time")


AT_ONCE = MoveOptions()

Kind = tuple[int, bool]
"""How many binary digits the size of a request has, and whether it is blended into another."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A motion that is planned and can be started.

    Attributes:
        motion: the motion.
        leave: where it leaves what runs before it; ``None`` where it begins at rest.
        move_options: how it is to begin and to end.
        chosen: when *leave* was chosen, monotonic clock, s.
        kind: of plan, which tells how long it takes.
    """

    motion: PlannedMotion
    leave: SplicePoint | None = None
    move_options: MoveOptions = AT_ONCE
    chosen: float = 0.0
    kind: Kind = (0, False)
