"""Slerp: one great arc between two orientations, the short way, the long way, or with spins."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import CumulativeCurve, cumulative_basis
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import (
    ParameterError,
    check_choice,
    check_integer,
    check_interval,
    check_quaternion,
    check_vector,
)
from orientd.rotation import between, log_half, nearer_sign

PATHS = ("short", "long", "as_is", "complement")
_COINCIDENT = 1e-14


class Slerp(CumulativeCurve):
    r"""Turn at constant angular velocity about one axis.

    .. math:: q(t) = q_0 \exp\bigl(u (\theta + n \pi) a\bigr), \quad u = (t - t_0) / (t_1 - t_0)

    with :math:`\theta a = \log(q_0^{-1} q_1)` in half angles (Shoemake, 1985).  Every uniform turn
    from one orientation to another about one axis is among these.  Nielson's (1993) spin of a
    whole turn prints :math:`\sqrt{2t - 4t^2}`; corrected to :math:`\sqrt{4t - 4t^2}` it still
    starts and ends with unbounded velocity, so it is made with ``spins=1`` and ``axis`` here.

    Picture: ``orientd plot slerp``.

    Args:
        q0: first orientation.
        q1: last orientation.
        t0: first instant, s.
        t1: last instant, s.
        path: ``"short"`` and ``"long"`` choose the sign of *q1*; ``"as_is"`` keeps it;
            ``"complement"`` goes the other way round the great circle of ``"as_is"`` (course
            notes on quaternion interpolation).
        spins: whole turns added, negative ones the other way.
        axis: body axis for orientations that coincide and so leave it open; otherwise not used.

    Raises:
        ValueError: a parameter is not as said, or the axis is open and not given.
    """

    name = "slerp"
    summary = "one great arc at constant velocity, with whole turns if wanted"
    source = "Shoemake 1985"
    interpolates = True
    takes = ("q0", "q1", "t0", "t1", "path", "spins", "axis")

    @takes_common_names
    def __init__(
        self,
        *,
        q0: ArrayLike,
        q1: ArrayLike,
        t0: float = 0.0,
        t1: float = 1.0,
        path: str = "short",
        spins: int = 0,
        axis: ArrayLike | None = None,
    ) -> None:
        start, end = check_quaternion(q0, "q0"), check_quaternion(q1, "q1")
        interval = check_interval(t0, t1)
        path = check_choice(path, "path", PATHS)
        turns = check_integer(spins, "spins")
        relative = between(start, end)
        if path in ("short", "long"):
            relative *= nearer_sign(*relative.tolist()) * (1.0 if path == "short" else -1.0)
        angle = math.atan2(float(np.linalg.norm(relative[1:])), float(relative[0]))
        angle += turns * math.pi - (2.0 * math.pi if path == "complement" else 0.0)
        direction = log_half(relative)
        if np.linalg.norm(relative[1:]) <= _COINCIDENT and abs(angle) > _COINCIDENT:
            if axis is None:
                raise ParameterError(
                    "axis",
                    "axis must be given for a turn between orientations that coincide, got None",
                )
            direction = check_vector(axis, "axis")
        elif axis is not None:
            check_vector(axis, "axis")
        length = float(np.linalg.norm(direction))
        if axis is not None and length == 0.0 and abs(angle) > 0.0:
            raise ParameterError("axis", f"axis must not be zero, got {axis!r}")
        increment = direction * (angle / length if length > 0.0 else 0.0)
        super().__init__(
            basis=cumulative_basis(np.repeat(interval, 2), 2),
            controls=np.stack([start, end]),
            increments=increment[None],
            continuity=2,
        )
