"""Rigid motion: a position curve beside an orientation curve of the same kind, carrying a body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves import Curve, KksBspline, KksHermite, KksInterpolating
from orientd.plots.papers.position_spline import (
    blended_positions,
    check_points,
    hermite_positions,
    interpolated_positions,
)
from orientd.rotation import Floats, rotate


class PositionCurve(Protocol):
    """What moves a body's origin."""

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last instant, in seconds."""
        ...

    def evaluate(self, times: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return position, velocity and acceleration in the world, SI units, ``(n, 3)`` each."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Where a body is and how it moves, at instants.

    Attributes:
        q: orientation, body to world, shape ``(n, 4)``.
        omega_body: angular velocity in the body frame, rad/s, ``(n, 3)``.
        alpha_body: its rate, rad/s^2.
        position: of the body's origin in the world, m.
        velocity: m/s.
        acceleration: m/s^2.
    """

    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats

    def placed(self, points: ArrayLike) -> Floats:
        """Return body points ``(k, 3)`` in the world at every instant, shape ``(n, k, 3)``."""
        body = check_points(points, "points", 1)
        return self.position[:, None] + rotate(self.q[:, None], body[None])

    def point_velocities(self, points: ArrayLike) -> Floats:
        """Return the velocities of body points in the world, m/s, shape ``(n, k, 3)``."""
        body = check_points(points, "points", 1)
        turning = np.cross(self.omega_body[:, None], body[None])
        return self.velocity[:, None] + rotate(self.q[:, None], turning)


class RigidMotion:
    """A body that turns along one curve while its origin moves along another.

    Kim, Kim and Shin (1995), sec. 6.2.  Use :func:`hermite_motion`, :func:`blended_motion` or
    :func:`interpolated_motion` for curves of the same kind, or any two over the same time.

    Args:
        orientation: any curve of orientations.
        position: a curve of positions over the same time.

    Raises:
        ValueError: the two are not defined over the same time.
    """

    def __init__(self, *, orientation: Curve, position: PositionCurve) -> None:
        if not np.allclose(orientation.domain, position.domain, rtol=1e-12, atol=0.0):
            raise ValueError(
                f"position must have the domain of orientation, {orientation.domain}, "
                f"got {position.domain}"
            )
        self.orientation, self.position = orientation, position

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last instant, in seconds."""
        return self.orientation.domain

    def evaluate(self, times: ArrayLike) -> Poses:
        """Return the poses at instants in the domain, shape ``(n,)``.

        Raises:
            ValueError: an instant is outside the domain.
        """
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return Poses(*self.orientation.evaluate(instants), *self.position.evaluate(instants))


def hermite_motion(
    *,
    q0: ArrayLike,
    q1: ArrayLike,
    omega0: ArrayLike,
    omega1: ArrayLike,
    p0: ArrayLike,
    p1: ArrayLike,
    v0: ArrayLike,
    v1: ArrayLike,
    t0: float = 0.0,
    t1: float = 1.0,
    revolutions: int = 0,
) -> RigidMotion:
    """Return the motion between two poses with velocities at both ends (their Fig. 7).

    Args:
        q0: first orientation.
        q1: last orientation.
        omega0: angular velocity at *t0*, rad/s.
        omega1: angular velocity at *t1*, rad/s.
        p0: first position, m.
        p1: last position, m.
        v0: velocity at *t0*, m/s, in the world.
        v1: velocity at *t1*, m/s.
        t0: first instant, s.
        t1: last instant, s.
        revolutions: whole turns added, as in ``kks_hermite``.

    Raises:
        ValueError: a parameter is not as said.
    """
    return RigidMotion(
        orientation=KksHermite(
            q0=q0, q1=q1, omega0=omega0, omega1=omega1, t0=t0, t1=t1, revolutions=revolutions
        ),
        position=hermite_positions(p0, p1, v0, v1, t0, t1),
    )


def blended_motion(
    *,
    control: ArrayLike,
    positions: ArrayLike,
    order: int = 4,
    knots: ArrayLike | None = None,
    align: bool = True,
) -> RigidMotion:
    """Return the motion drawn by control poses (their Figs. 8 and 9).

    Args:
        control: control quaternions.
        positions: as many control points, m.
        order: degree plus one, at least 2.
        knots: of both curves, as for ``kks_bspline``.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """
    orientation = KksBspline(control=control, order=order, knots=knots, align=align)
    points = check_points(positions, "positions", order)
    if len(points) != len(np.asarray(control)):
        raise ValueError(
            f"positions must be as many as control, {len(np.asarray(control))}, got {len(points)}"
        )
    return RigidMotion(orientation=orientation, position=blended_positions(points, order, knots))


def interpolated_motion(
    *,
    keys: ArrayLike,
    positions: ArrayLike,
    times: str | ArrayLike | None = None,
    order: int = 4,
    omega_start: ArrayLike | None = None,
    omega_end: ArrayLike | None = None,
    velocity_start: ArrayLike | None = None,
    velocity_end: ArrayLike | None = None,
    align: bool = True,
) -> RigidMotion:
    """Return the motion through poses (their Fig. 10).

    Args:
        keys: orientations of the keyframes.
        positions: of the keyframes, m, shape ``(n, 3)``.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        order: degree plus one of both curves, 3 to 6.
        omega_start: body angular velocity at the first keyframe, rad/s; natural without it.
        omega_end: body angular velocity at the last keyframe.
        velocity_start: velocity at the first keyframe, m/s, in the world; natural without it.
        velocity_end: velocity at the last keyframe.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: no orientation curve could be found.
    """
    orientation = KksInterpolating(
        keys=keys,
        times=times,
        order=order,
        start="natural" if omega_start is None else "clamped",
        end="natural" if omega_end is None else "clamped",
        omega_start=omega_start,
        omega_end=omega_end,
        align=align,
    )
    points = check_points(positions, "positions", 2)
    return RigidMotion(
        orientation=orientation,
        position=interpolated_positions(
            points, orientation.key_times, order, velocity_start, velocity_end
        ),
    )
