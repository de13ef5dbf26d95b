"""What every curve on the rotation group promises: domain, knots, continuity, evaluation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, wraps
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.family import Family, is_same, kept
from orientd.curves.roles import own_names
from orientd.curves.trajectory import Samples, Trajectory
from orientd.drawing import Drawable
from orientd.rotation import Floats, to_scipy, unnamed

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""How far outside its domain, relative to the larger end, a curve still takes an instant."""


_AS_THEY_ARE = (float, int, str, bool, type(None))

_FEW = 8
"""Numbers that a parameter may have to be shown in full."""


class Curve(Family, Drawable):
    """A curve of orientations over an interval of time.

    A family subclasses this, computes what it needs in its constructor, whose keyword-only
    arguments are those that it :attr:`takes`, and says :meth:`_orientations`.  By
    :func:`takes_common_names` every family also takes ``keys``, ``times`` (``None`` goes by chord
    length), ``start_velocity`` and ``end_velocity`` (rad/s, in ``velocity_frame``), and ``turns``
    (whole turns in each interval); :mod:`orientd.curves.roles` says what they are to it.
    Orientations may be ``Rotation``, named quaternions or arrays ``(w, x, y, z)``.

    Curves are equal that are of one family and made of the same parameters.

    Attributes:
        continuity: how many derivatives of the orientation are continuous at the knots for the
            parameters at hand: 0, 1 or 2.  A single segment has no knots inside and says 2.
        made_of: the parameters by the family's own names; not to be changed.
    """

    continuity: int
    made_of: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, *, knots: ArrayLike, continuity: int) -> None:
        """Set the break points of the curve, domain ends included, and its continuity there."""
        self._knots: Floats = np.array(knots, dtype=np.float64)
        self._knots.setflags(write=False)
        self._start = float(self._knots[0])
        self._end = float(self._knots[-1])
        self._slack = ROUNDING * max(abs(self._start), abs(self._end))
        self.continuity = min(continuity, 2)

    @property
    def knots(self) -> Floats:
        """The increasing instants, in seconds, at which the formula changes, and both ends."""
        return self._knots

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last instant, in seconds, at which the curve is defined."""
        return self._start, self._end

    def evaluate(self, times: ArrayLike, *, out: Floats | None = None) -> Samples:
        """Return orientation, body angular velocity and body angular acceleration.

        At a knot the values are those of the segment that begins there, at the end of the domain
        those of the last segment.

        Args:
            times: instants in seconds inside :attr:`domain`, any shape, in any order; increasing
                ones are quickest.
            out: a C-contiguous float64 array of shape ``(10, n)``, *n* the number of instants, to
                fill: four rows of orientation, three of angular velocity, three of angular
                acceleration.  The arrays returned are views of it.  Without it they are new.

        Returns:
            Quaternions ``(..., 4)`` scalar first, whose sign is continuous along the curve;
            angular velocity ``2 vec(q* q')`` in rad/s in the body frame, ``(..., 3)``; its rate
            in rad/s^2 in the body frame, ``(..., 3)``; leading axes as in *times*.

        Raises:
            ValueError: an instant is outside the domain (rounding apart) or not a number, or
                *out* does not fit.
        """
        instants = np.asarray(times, dtype=np.float64)
        flat = self._inside(instants.reshape(-1))
        if out is not None:
            check_out(out, flat.size)
        q, omega_body, alpha_body = self.trajectory.sample(flat, out)
        if instants.ndim == 1:
            return q, omega_body, alpha_body
        return in_shape(instants.shape, q, omega_body, alpha_body)

    def __call__(self, times: ArrayLike) -> Rotation:
        """Return the orientations at *times* (s, one or a row) as a ``Rotation`` of SciPy.

        Raises:
            ValueError: an instant is outside the domain or not a number.
        """
        return to_scipy(self.evaluate(times)[0])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Curve):
            return NotImplemented
        return type(self) is type(other) and is_same(self.made_of, other.made_of)

    def __hash__(self) -> int:
        return hash((type(self), self.domain, len(self._knots)))

    def __repr__(self) -> str:
        start, end = self.domain
        parts = [f"{start:g} s to {end:g} s", f"C{self.continuity}"]
        parts += [f"{name}={_in_short(value)}" for name, value in self.made_of.items()]
        return f"<{type(self).__name__}: {', '.join(parts)}>"

    def ends(self) -> Samples:
        """Return what :meth:`evaluate` does at both ends of the domain."""
        return self.evaluate(np.array(self.domain))

    @cached_property
    def trajectory(self) -> Trajectory:
        """The table that the curve is sampled from, fitted when it is first needed."""
        fitted = Trajectory.fit(self._orientations, self._knots, continuity=self.continuity)
        return fitted.pinned(*self._end_states)

    @property
    def _end_states(self) -> tuple[tuple[Floats | None, Floats | None], ...]:
        """Velocities and accelerations that were asked for at both ends; ``None`` for none."""
        return (None, None), (None, None)

    def _orientations(self, times: Floats) -> Floats:
        """Return quaternions of either sign at *times* inside the domain, shape ``(n, 4)``.

        This is what a family has to say; velocities and accelerations follow from it.
        """
        raise NotImplementedError

    def _inside(self, times: Floats) -> Floats:
        """Return *times* with rounding beyond the ends cut off, refusing more than that."""
        is_outside = ~((times >= self._start - self._slack) & (times <= self._end + self._slack))
        if is_outside.any():
            worst = float(times[int(np.argmax(is_outside))])
            raise ValueError(
                f"times must be in the domain [{self._start!r}, {self._end!r}] s, got {worst!r}"
            )
        clipped: Floats = np.clip(times, self._start, self._end)
        return clipped

    def _segments(self, times: Floats) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Return the index of the knot span of each instant, the last span closed at its end."""
        interior = self._knots[1:-1]
        spans: np.ndarray[tuple[int], np.dtype[np.intp]] = np.searchsorted(
            interior, times, side="right"
        )
        return spans


def takes_common_names(make: Callable[..., None]) -> Callable[..., None]:
    """Let the constructor of a family take the names common to all, and orientations of any kind.

    The curve keeps what it was made of, by the family's own names.
    """

    @wraps(make)
    def construct(self: Curve, **given: Any) -> None:  # noqa: ANN401
        for name, value in given.items():
            if not isinstance(value, np.ndarray) and type(value) not in _AS_THEY_ARE:
                given[name] = unnamed(value)
        if not given.keys() <= set(self.takes):
            given = own_names(type(self), given)
        make(self, **given)
        self.made_of = {name: kept(value) for name, value in given.items()}

    return construct


def _in_short(value: object) -> str:
    """Return a parameter in a few words."""
    if not isinstance(value, np.ndarray) or value.size <= _FEW:
        return repr(value.tolist() if isinstance(value, np.ndarray) else value)
    return f"array of shape {value.shape}"


def in_shape(shape: tuple[int, ...], q: Floats, omega_body: Floats, alpha_body: Floats) -> Samples:
    """Return samples at a row of instants with the leading axes that the instants had."""
    return q.reshape(*shape, 4), omega_body.reshape(*shape, 3), alpha_body.reshape(*shape, 3)


def check_out(out: Floats, count: int) -> None:
    """Refuse a buffer that is not writable, C-contiguous float64 of shape ``(10, count)``.

    Raises:
        ValueError: it is not.
    """
    if out.shape != (10, count) or out.dtype != np.float64 or not out.flags.carray:
        raise ValueError(
            f"out must be a writable C-contiguous float64 array of shape (10, {count}), "
            f"got {out.dtype} of shape {out.shape}"
        )
