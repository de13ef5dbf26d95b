"""Plan whole passes of known targets, once the positions of a program follow one."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from orientd.client.move_handle import MoveHandle
from orientd.errors import DeadlineError, OrientdError
from orientd.rotation import Floats
from orientd_rotctld.ranges import Ranges
from orientd_rotctld.satellite_pass import satellite_pass
from orientd_rotctld.sky import Pass, Target, find_pass
from orientd_serving.pointing import Direction, angles
from orientd_serving.served import Served

_MARGIN = 1.0
"""Seconds from the end of planning to the start of the motion."""
_PLANNING = 2.0
"""Usual time to plan a pass, s."""
_LEAST = 0.2
"""Seconds that the daemon needs to arm a motion."""
_SHORTEST = 10.0
"""Remaining pass that is still planned, s."""
_TRIES = 4
"""Plans of a pass, each with a later start if the one before took too long."""
_BEHIND = math.radians(0.5)
"""Angle behind a target from which the rest of its pass is planned again, rad."""


class Passes:
    """Passes of known targets for one device."""

    def __init__(
        self,
        served: Served,
        targets: Sequence[Target],
        *,
        ranges: Ranges,
        notify: Callable[[str], None],
    ) -> None:
        """Follow no pass yet.

        Args:
            served: the device.
            targets: the known ones.
            ranges: of the directions to point at.
            notify: takes lines for people.
        """
        self._served, self._ranges, self._notify = served, ranges, notify
        self._targets = targets
        self._pass: Pass | None = None
        self._otherwise: Callable[[], None] = lambda: None
        self._motion: MoveHandle | None = None
        self._begun = 0.0
        self._planning: threading.Thread | None = None
        self._refused: set[tuple[str, int]] = set()

    def takes(self, point: Floats, otherwise: Callable[[], None]) -> bool:
        """Return whether a position belongs to a pass, which is then planned and followed.

        Args:
            point: unit vector of the position: x to the north, y to the west, z up.
            otherwise: points at the position; called with the lock of the device if the pass
                cannot be planned.
        """
        self._otherwise = otherwise
        now = time.time()
        current = self._pass
        if current is not None and now < current.end:
            is_planned = self._planning is not None and self._planning.is_alive()
            if (is_planned or self._is_followed(current)) and current.is_meant(now, point):
                return True
        self._pass = None
        found = find_pass(self._targets, now, point)
        if found is None or _key(found) in self._refused or found.end < now + _SHORTEST:
            return False
        if problem := self._beyond(found, now):
            self._refused.add(_key(found))
            self._notify(f"{found.target.name}: {problem}; points at each position instead")
            return False
        self._pass = found
        before = self._planning
        self._planning = threading.Thread(target=self._plan, args=(found, before), daemon=True)
        self._planning.start()
        return True

    def _beyond(self, found: Pass, now: float) -> str:
        """Return where a pass leaves the ranges; empty if it stays in them."""
        path = found.target.at(found.times(max(found.start, now)))
        for east, up in angles(path).tolist():
            if not self._ranges.has_form(Direction(east, up)):
                (west, most), (low, high) = self._ranges.azimuth, self._ranges.elevation
                return (
                    f"the pass leaves the ranges (--azimuth {west:g}:{most:g}, --elevation "
                    f"{low:g}:{high:g}) at azimuth {east % 360.0:.1f}, elevation {up:.1f}"
                )
        return ""

    def _is_followed(self, current: Pass) -> bool:
        """Return whether the motion along a pass continues, and in time.

        A servo whose machine did not run it in time resumes where it was, and stays behind.
        """
        motion = self._motion
        if motion is None or motion.is_done:
            return False
        report = self._served.report()
        now = time.time()
        if report.motion_number != motion.motion_number or report.is_paused or report.speed < 1.0:
            return True
        reached = min(now, self._begun + report.path_time + report.cycle_age)
        return math.dist(current.point(now), current.point(reached)) < _BEHIND

    def leave(self) -> None:
        """Follow no pass any longer; the motion is not stopped."""
        self._pass = None

    def close(self) -> None:
        """Follow no pass any longer, and return when none is planned or waits for its start."""
        self._pass = None
        planning = self._planning
        # A motion may be on its way to the daemon when the first stop arrives.
        while planning is not None and planning.is_alive():
            with contextlib.suppress(OrientdError):
                self._served.robot.stop(self._served.name)
            planning.join(0.5)

    def _plan(self, wanted: Pass, before: threading.Thread | None) -> None:
        """Plan the rest of a pass from rest, and start it, once the thread before has ended."""
        name = wanted.target.name
        if before is not None:
            before.join()
        try:
            # With the lock, a position elsewhere comes before this or after it, and is not stopped.
            with self._served.lock:
                if self._pass is not wanted:
                    return
                self._served.rest()
            self._begin(wanted)
        except OrientdError as error:
            if self._pass is not wanted:
                return
            # Before the rise nothing is lost if the next position has it planned again.
            if not isinstance(error, DeadlineError) or time.time() > wanted.start:
                self._refused.add(_key(wanted))
            self._point_instead(wanted, f"{name}: no plan of the whole pass: {error}")

    def _point_instead(self, wanted: Pass, problem: str) -> None:
        """Point at the newest position that was asked for, unless the pass has been left."""
        with self._served.lock:
            if self._pass is not wanted:
                return
            self._notify(f"{problem}; points at the position that was asked for instead")
            try:
                self._otherwise()
            except OrientdError as error:
                self._notify(f"{wanted.target.name}: the position was refused too: {error}")
            if self._pass is not wanted:
                self._served.rest()  # a stop came while the daemon took the motion
            self._pass = None

    def _begin(self, wanted: Pass) -> None:
        start = max(wanted.start, time.time() + _PLANNING + _MARGIN)
        for _ in range(_TRIES):
            times = wanted.times(start)
            azimuth, elevation = angles(wanted.target.at(times)).T
            azimuth = np.unwrap(azimuth, period=360.0) - math.remainder(self._ranges.north, 360.0)
            request = satellite_pass(times - start, azimuth, elevation, name=wanted.target.name)
            asked = time.time()
            plan = self._served.robot.plan(request, device=self._served.name)
            now, begin = time.time(), start - plan.start_time
            if self._pass is not wanted:
                return
            if begin > now + _LEAST:
                # The target is also lost until the path begins.
                lost = start - wanted.start
                lost += sum(one.end - one.start for one in plan.certificate.losses)
                with self._served.lock:
                    if self._pass is not wanted:
                        return
                    self._notify(
                        f"{wanted.target.name}: the pass is planned, from {start - now:.0f} s "
                        f"to {wanted.end - now:.0f} s from now, off target for {lost:.1f} s"
                    )
                    self._begun = begin
                    self._motion = self._served.move(plan, start_time=begin)
                if self._pass is not wanted:
                    self._motion.cancel()  # a stop came while the daemon took the motion
                return
            start = now + plan.start_time + (now - asked) + _MARGIN
        raise OrientdError("planning took too long")


def _key(one: Pass) -> tuple[str, int]:
    return one.target.name, round(one.end / 60.0)
