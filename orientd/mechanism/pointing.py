"""How well the axes of a gimbal make a path: pointing error, roll, and distance from the pole."""

from __future__ import annotations

from math import degrees

import numpy as np

from orientd.errors import LimitError, LimitKind
from orientd.mechanism.arrays import of_arrays
from orientd.mechanism.figure import Figure
from orientd.mechanism.gimbal import Gimbal
from orientd.rotation import Floats, angle, conjugate, rotate


def pointing_error(gimbal: Gimbal, reached: Floats, q: Floats) -> Floats:
    """Return the angle between orientations; for two axes, between the pointing directions, rad.

    Args:
        gimbal: the gimbal.
        reached: orientations of its axes, shape ``(n, 4)``.
        q: requested orientations, shape ``(n, 4)``.
    """
    if len(gimbal.axes) == 3:
        return angle(reached, q)
    back = conjugate(np.array(gimbal.kinematics.tool))
    pointed = rotate(back, np.eye(3)[gimbal.kinematics.inner_axis])
    made, asked = rotate(reached, pointed), rotate(q, pointed)
    cross = np.linalg.norm(np.cross(made, asked), axis=1)
    return np.asarray(np.arctan2(cross, np.sum(made * asked, axis=1)), dtype=np.float64)


def figures_of(
    gimbal: Gimbal,
    joints: Floats,
    reached: Floats,
    asked: Floats,
    period: float,
    error: tuple[float, float | None],
) -> tuple[Figure, ...]:
    """Return the figures of a certificate about the way that the axes take.

    Args:
        gimbal: the gimbal.
        joints: axis angles at the records, rad, shape ``(n, axes)``.
        reached: orientations for these angles, shape ``(n, 4)``.
        asked: orientations of the path there, shape ``(n, 4)``.
        period: between the records, s.
        error: largest angle between requested and planned path outside slews, rad, and its time,
            if that is known.

    Raises:
        LimitError: two axes deviate too much from the orientations *asked*.
    """
    missed, when = error
    rolled = angle(reached, asked)
    if gimbal.is_fitting and missed > float(np.max(rolled)):
        # Two axes already were on a path of their own, that far from the requested one.
        rolled, missed = np.full_like(rolled, missed), 0.0
    figures = [Figure("pointing error", missed, "rad", gimbal.max_deviation, when)]
    figures.append(manipulability(gimbal, joints))
    if gimbal.is_fitting:
        figures.append(_roll(gimbal, rolled, period))
    return tuple(figures)


def manipulability(gimbal: Gimbal, joints: Floats) -> Figure:
    """Return the distance of *joints* (rad, shape ``(n, axes)``) from the pole, which is at 0."""
    least = float(np.min(of_arrays(gimbal).manipulability(joints.T)))
    return Figure("manipulability", least, "1")


def _roll(gimbal: Gimbal, missed: Floats, period: float) -> Figure:
    """Return the orientation error of two axes, which lack a degree of freedom.

    Raises:
        LimitError: the error is larger than allowed.
    """
    at, most = int(np.argmax(missed)), gimbal.roll_tolerance
    value, time = float(missed[at]), at * period
    if value > most:
        raise LimitError(
            "orientation error of the two axes", value, most, time, "rad",
            f"at most {degrees(most):.2f} deg are allowed; `pointing = true` follows the "
            "direction alone", kind=LimitKind.DEVIATION,
        )  # fmt: skip
    return Figure("orientation error", value, "rad", most, time)
