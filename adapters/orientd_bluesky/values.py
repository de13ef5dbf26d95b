"""Fly scans, and the status of an action, as bluesky exchanges them with an axis."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Self

from orientd.errors import RequestError


class MotionStatus:
    """The state of an action, as bluesky's protocol ``Status`` has it.

    Attributes:
        is_stop_success: whether the action counts as successful if it is stopped.
    """

    def __init__(self) -> None:
        self.is_stop_success = False
        self._end: Future[None] = Future()

    @property
    def done(self) -> bool:
        """Whether the action has ended, in any way."""
        return self._end.done()

    @property
    def success(self) -> bool:
        """Whether it has ended without an error."""
        return self.done and self._end.exception() is None

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return the error of the action, or ``None``.

        Args:
            timeout: longest wait for its end, s; ``None`` for no limit.

        Raises:
            TimeoutError: it has not ended.
        """
        return self._end.exception(timeout)

    def add_callback(self, callback: Callable[[Any], None]) -> None:
        """Call *callback* with this object at the end of the action; at once if it has ended."""
        self._end.add_done_callback(lambda _: callback(self))

    def finish(self, error: BaseException | None = None) -> Self:
        """End the action, with an error if it failed, and return this object."""
        if error is None:
            self._end.set_result(None)
        else:
            self._end.set_exception(error)
        return self


@dataclass(frozen=True, kw_only=True)
class FlyScan:
    """A turn at a constant rate past equally spaced points.

    Attributes:
        start_deg: angle of the first point, degrees.
        stop_deg: angle of the last point, degrees.
        points: number of points, at least 2.
        time_per_point: from each point to the next, s.

    Raises:
        RequestError: the points do not make a turn.
    """

    start_deg: float
    stop_deg: float
    points: int
    time_per_point: float

    def __post_init__(self) -> None:
        for name in ("start_deg", "stop_deg", "time_per_point"):
            if not math.isfinite(getattr(self, name)):
                raise RequestError(name, f"expected a number, got {getattr(self, name)!r}")
        if self.points != int(self.points) or self.points < 2:
            raise RequestError("points", f"expected a whole number from 2, got {self.points!r}")
        if self.time_per_point <= 0.0:
            raise RequestError("time_per_point", f"expected seconds, got {self.time_per_point!r}")
        if self.start_deg == self.stop_deg:
            raise RequestError("stop_deg", f"expected another angle than {self.start_deg:g}")

    @property
    def duration(self) -> float:
        """Time from the first to the last point, s."""
        return (self.points - 1) * self.time_per_point

    @property
    def rate(self) -> float:
        """Angular velocity, rad/s; negative if the angle decreases."""
        return math.radians(self.stop_deg - self.start_deg) / self.duration
