"""Targets in the sky whose path is known, and their passes; satellites by orbital elements."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orientd.errors import OrientdError
from orientd.rotation import Floats
from orientd.sun import sidereal_time
from orientd_serving.pointing import vectors

_SIGHT = math.radians(1.0)
"""Largest angle from a target to a position that means it, rad."""
_STILL_SIGHT = math.radians(1.5)
"""The same for a pass that is followed, rad."""
_LATE, _EARLY = 0.5, 5.0
"""How long ago or in how long a target may be at a position that means it, s."""
_NEAR_STEP = 0.01
"""Seconds from one look to the next for a target near a position."""
_AHEAD = 900.0
"""How long before its rise a target may be waited for, s."""
_HIGHEST_MASK = math.radians(30.0)
"""Largest elevation at which a program waits for a target, rad."""
_LONGEST = 3600.0
"""Longest part of a pass that is planned at once, s."""
_STEP = 1.0
"""Seconds from one look for a rise to the next."""
_EXACT = 1e-3
"""Largest error of the time of a rise, s."""
_FINE = 0.2
_STRIDE, _PAUSE = math.radians(3.0), 20.0
"""Largest angle, rad, and longest time, s, from one row of a pass to the next."""
_UNIX_EPOCH = 2440587.5
_EARTH, _FLATTENING = 6378.137, 1.0 / 298.257223563
"""WGS 84: equatorial radius, km."""


@dataclass(frozen=True, slots=True)
class Target:
    """A target and its way.

    Attributes:
        name: of the target.
        at: returns its unit vectors for times since the epoch, s, shape ``(n,)``: x to the north, y
            to the west, z up, shape ``(n, 3)``; NaN when its place is not known.
    """

    name: str
    at: Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class Pass:
    """A target from a time until it sets.

    Attributes:
        target: the target.
        start: when it rises above the elevation at which a program waits for it, or now if it is up
            already, Unix time in s.
        end: when it sets, Unix time in s.
    """

    target: Target
    start: float
    end: float

    def point(self, now: float) -> Floats:
        """Return where it is, or where it will be at the start, as a unit vector."""
        point: Floats = self.target.at(np.array([max(now, self.start)]))[0]
        return point

    def is_meant(self, now: float, point: Floats) -> bool:
        """Return whether a program that follows the pass may send a position.

        Args:
            now: Unix time in s.
            point: unit vector of the position.
        """
        if math.dist(self.point(now), point) < _STILL_SIGHT:
            return True
        return now > self.start - _EARLY and _is_near(self.target, now, point, _STILL_SIGHT)

    def times(self, start: float) -> Floats:
        """Return times from *start* to the end, closer where the target is quicker, s."""
        fine = np.linspace(start, self.end, max(3, math.ceil((self.end - start) / _FINE)))
        steps = np.linalg.norm(np.diff(self.target.at(fine), axis=0), axis=1)
        rows = np.cumsum(steps / _STRIDE + np.diff(fine) / _PAUSE, dtype=np.float64)
        count = max(3, math.ceil(rows[-1]) + 1)
        found: Floats = np.interp(np.linspace(0.0, rows[-1], count), [0.0, *rows], fine)
        return found


def find_pass(targets: Sequence[Target], now: float, point: Floats) -> Pass | None:
    """Return the pass that a position means, among those above the horizon or about to rise.

    The target is at the position within seconds, or a program waits there for its rise above the
    elevation of the position: above the horizon, or above a mask of its own.

    Args:
        targets: the known ones.
        now: Unix time in s.
        point: unit vector of the position.
    """
    passes = [
        Pass(target, start, _end(target, start))
        for target in targets
        if (start := _start(target, now, point)) is not None
    ]
    return min(passes, key=lambda one: math.dist(one.point(now), point), default=None)


def _start(target: Target, now: float, point: Floats) -> float | None:
    """Return when the next pass begins that a position means: now, or at a rise."""
    heights = target.at(now + np.arange(0.0, _AHEAD + _STEP, _STEP))[:, 2]
    soon = heights[: math.ceil(_EARLY / _STEP) + 1] > 0.0
    if soon.any() and _is_near(target, now, point, _SIGHT):
        row = int(np.argmax(soon))
        return _change(target, now + (row - 1) * _STEP, 0.0) if row else now
    mask = max(float(point[2]), 0.0)
    if mask > math.sin(_HIGHEST_MASK):
        return None
    is_above = heights > mask
    for row in np.flatnonzero(~is_above[:-1] & is_above[1:]).tolist():
        rise = _change(target, now + row * _STEP, mask)
        if math.dist(target.at(np.array([rise]))[0], point) < _SIGHT:
            return rise
    return None


def _is_near(target: Target, now: float, point: Floats, sight: float) -> bool:
    """Return whether a target above the horizon is at a position within seconds of *now*."""
    places = target.at(np.arange(now - _LATE, now + _EARLY, _NEAR_STEP))
    apart = np.linalg.norm(places[places[:, 2] > 0.0] - point, axis=1)
    return bool(np.any(apart < sight))


def _end(target: Target, start: float) -> float:
    """Return when a target that is up sets, or an hour later."""
    is_up = target.at(start + np.arange(0.0, _LONGEST, _STEP))[:, 2] > 0.0
    if is_up.all():
        return start + _LONGEST
    return _change(target, start + (int(np.argmin(is_up)) - 1) * _STEP, 0.0)


def _change(target: Target, before: float, height: float) -> float:
    """Return when a target passes a height within a step, at a time at which it is above it.

    Args:
        target: the target.
        before: beginning of the step, Unix time in s.
        height: sine of the elevation.
    """
    times = np.linspace(before, before + _STEP, math.ceil(_STEP / _EXACT) + 1)
    is_above = target.at(times)[:, 2] > height
    # It is above at one end of the step: rounding of the times must not hide that.
    is_above[-1] = not is_above[0]
    return float(times[np.argmin(is_above) - 1 if is_above[0] else np.argmax(is_above)])


def from_elements(path: Path, observer: tuple[float, float, float]) -> list[Target]:
    """Return the satellites of a file of two-line elements, with or without lines of names.

    Args:
        path: the file.
        observer: latitude and longitude, degrees, and height above the ellipsoid, m.

    Raises:
        OrientdError: the file cannot be read or has no elements, or sgp4 is not installed.
    """
    try:
        from sgp4.api import Satrec
    except ImportError:
        raise OrientdError(
            "this needs the extra `satellite`: pip install 'orientd-motion[satellite]'"
        ) from None
    lines = [line.rstrip() for line in text_of(path).splitlines() if line.strip()]
    targets = []
    for place, line in enumerate(lines[:-1]):
        if not (line.startswith("1 ") and lines[place + 1].startswith("2 ")):
            continue
        above = lines[place - 1] if place else ""
        name = above.removeprefix("0 ").strip() if above[:2] not in ("", "2 ") else line[2:7]
        try:
            satellite = Satrec.twoline2rv(line, lines[place + 1])
        except ValueError as error:
            raise OrientdError(f"{path}: the elements of {name} are damaged: {error}") from None
        targets.append(Target(name, _seen(satellite, observer)))
    if not targets:
        raise OrientdError(f"{path}: expected two-line elements, found none")
    return targets


def text_of(path: Path) -> str:
    """Return the text of a file.

    Raises:
        OrientdError: it cannot be read, or is no text.
    """
    try:
        return path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file; save it as UTF-8"
        raise OrientdError(f"{path}: {reason}") from None


def _seen(satellite: object, observer: tuple[float, float, float]) -> Callable[[Floats], Floats]:
    """Return the function of a satellite's unit vectors as an observer sees it."""
    latitude, longitude, height = observer
    sine = math.sin(math.radians(latitude))
    squeeze = _FLATTENING * (2.0 - _FLATTENING)
    curve = _EARTH / math.sqrt(1.0 - squeeze * sine**2)
    # In the axes of the earth longitude counts the other way round than azimuth.
    up, north = vectors(-longitude, latitude), vectors(-longitude, latitude + 90.0)
    axes = np.stack([north, np.cross(up, north), up])
    place = (curve + 1e-3 * height) * up - np.array([0.0, 0.0, curve * squeeze * sine])

    def at(times: Floats) -> Floats:
        errors, places, _ = satellite.sgp4_array(  # type: ignore[attr-defined] # Satrec of sgp4
            np.full(len(times), _UNIX_EPOCH), times / 86400.0
        )
        turn = np.radians(sidereal_time(times, 0.0))  # type: ignore[arg-type]
        x, y, z = np.where(errors[:, None] == 0, places, np.nan).T
        fixed = np.column_stack(
            [x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn), z]
        )
        seen = (fixed - place) @ axes.T
        unit: Floats = seen / np.linalg.norm(seen, axis=1, keepdims=True)
        return unit

    return at
