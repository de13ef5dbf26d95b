"""Make data for the figures of the papers: the papers print no numbers.

Every function here returns the same data each time it is called.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orientd.curves import Curve, CurveTask, cumulative_basis
from orientd.curves.hermite import KksHermite
from orientd.curves.interpolating import KksInterpolating
from orientd.curves.products import KksBspline
from orientd.plots.bodies import Face, SweptPoses, prism
from orientd.rotation import Floats, exp, from_euler, multiply

SAMPLED = np.array([0.0, 0.16, 0.31, 0.44, 0.60, 0.64, 0.83, 1.0])
"""Where the ideal orientation function is sampled; the fifth and sixth are close together."""


def ideal_orientation(share: Floats) -> Floats:
    """Return an orientation function like that of Nielson (1993), Figs. 10 and 11.

    As there, the tip of one axis, here x, begins and ends at the same place.

    Args:
        share: from 0 to 1, shape ``(n,)``.

    Returns:
        Unit quaternions, shape ``(n, 4)``.
    """
    turn = 2.0 * np.pi * share
    loop = np.stack(
        [0.85 * np.sin(turn), 0.45 * np.sin(2.0 * turn) + 0.15 * (np.cos(turn) - 1.0)], axis=-1
    )
    roll = np.zeros((len(share), 3))
    roll[:, 0] = 2.4 * share + 0.5 * np.sin(turn)
    return multiply(from_euler("ZY", loop), exp(roll))


def samples_of_ideal() -> Floats:
    """Return the eight sample orientations, shape ``(8, 4)``."""
    return ideal_orientation(SAMPLED)


CONTROL_DEGREES = [
    [40.0, -20.0, 0.0],
    [10.0, -35.0, 60.0],
    [-30.0, 20.0, 130.0],
    [10.0, 25.0, 200.0],
    [45.0, -25.0, 250.0],
    [-30.0, -15.0, 320.0],
]
CONTROL_POINTS = np.array(
    [
        [0.0, 0.0, 0.0],
        [2.2, 1.2, 1.5],
        [4.4, -0.6, 2.0],
        [6.4, 0.2, 0.2],
        [8.2, 1.8, 0.8],
        [10.4, 0.8, 2.0],
    ]
)


CONTROL_KNOTS = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0])
"""Of the cubic B-splines over these six, a second apart inside."""


def control_orientations() -> Floats:
    """Return the six control orientations of Figs. 6, 8, 9 and 10, shape ``(6, 4)``."""
    return from_euler("ZYX", np.radians(CONTROL_DEGREES))


@dataclass(frozen=True, slots=True, eq=False)
class PaperScene:
    """A rigid motion to draw: a body that turns along one curve and travels along another.

    The two are of the same kind, over the same time (Kim, Kim and Shin, 1995, secs. 4.2 and 6.2).

    Attributes:
        orientation: how the body turns.
        position: gives where its origin is at instants, m, shape ``(n, 3)``.
        keyframes: poses drawn dark.
    """

    orientation: Curve
    position: Callable[[Floats], Floats]
    keyframes: SweptPoses

    def between(self, count: int) -> SweptPoses:
        """Return *count* poses evenly spaced in time, the ends left out."""
        start, end = self.orientation.domain
        evenly = start + (end - start) * (np.arange(count) + 0.5) / count
        return self._poses(evenly)

    def along(self, count: int) -> SweptPoses:
        """Return *count* poses evenly spaced in time from end to end."""
        return self._poses(np.linspace(*self.orientation.domain, count))

    def _poses(self, times: Floats) -> SweptPoses:
        return SweptPoses(self.position(times), self.orientation.evaluate(times)[0])


def blended_scene() -> PaperScene:
    """Return the motion of Figs. 8 and 9: a cubic B-spline over six control poses."""
    controls = control_orientations()
    orientation = KksBspline(control=controls, knots=CONTROL_KNOTS)
    basis = cumulative_basis(CONTROL_KNOTS, 4)
    steps = np.diff(CONTROL_POINTS, axis=0)

    def position(times: Floats) -> Floats:
        span = np.clip(np.searchsorted(basis.breaks, times, side="right"), 1, 3) - 1
        varying = basis.first[span][:, None] - 1 + np.arange(3)
        shares = basis.at(span, times)[0].T[..., None]
        moved: Floats = CONTROL_POINTS[varying[:, 0]] + np.sum(shares * steps[varying], axis=1)
        return moved

    return PaperScene(orientation, position, SweptPoses(CONTROL_POINTS, controls))


def interpolated_scene() -> PaperScene:
    """Return the motion of Fig. 10: six keyframes interpolated with continuous acceleration."""
    keys = control_orientations()
    orientation = KksInterpolating(keys=keys, times="uniform", order=4)
    # The velocities of the natural cubic spline, whose knots are evenly spaced.
    count, interval = len(keys), float(orientation.knots[1] - orientation.knots[0])
    matrix = np.diag([2.0, *[4.0] * (count - 2), 2.0]) + np.eye(count, k=1) + np.eye(count, k=-1)
    padded = np.pad(CONTROL_POINTS, ((1, 1), (0, 0)), mode="edge")
    velocities = np.linalg.solve(matrix, 3.0 / interval * (padded[2:] - padded[:-2]))
    position = _cubics(orientation.knots, CONTROL_POINTS, velocities)
    return PaperScene(orientation, position, SweptPoses(CONTROL_POINTS, keys))


def _cubics(times: Floats, places: Floats, velocities: Floats) -> Callable[[Floats], Floats]:
    """Return the cubics through *places* (m) with *velocities* (m/s) at *times*."""
    intervals = np.diff(times)

    def position(at: Floats) -> Floats:
        span = np.clip(np.searchsorted(times, at, side="right"), 1, len(intervals)) - 1
        interval = intervals[span][:, None]
        ahead = (at - times[span])[:, None] / interval
        back = 1.0 - ahead
        leaving = (1.0 + 2.0 * ahead) * places[span] + ahead * interval * velocities[span]
        arriving = (1.0 + 2.0 * back) * places[span + 1] - back * interval * velocities[span + 1]
        moved: Floats = back**2 * leaving + ahead**2 * arriving
        return moved

    return position


FLIGHT_TIME = 2.6
SPIN = 16.0


def boomerang_task() -> CurveTask:
    """Return the two orientations of the boomerang of Fig. 7, with its spin at both ends."""
    return CurveTask(
        keys=from_euler("XYZ", np.radians([[-65.0, 10.0, 0.0], [-15.0, -10.0, 40.0]])),
        times=np.array([0.0, FLIGHT_TIME]),
        omega_start=np.array([0.0, 0.0, SPIN]),
        omega_end=np.array([0.0, 0.0, SPIN]),
    )


def boomerang_scene() -> PaperScene:
    """Return the flight of Fig. 7: one Hermite segment for each of position and orientation."""
    keys = boomerang_task().keys
    spin = [0.0, 0.0, SPIN]
    orientation = KksHermite(q0=keys[0], q1=keys[1], omega0=spin, omega1=spin, t1=FLIGHT_TIME)
    places = np.array([[0.0, 0.0, 1.6], [0.9, -1.6, 1.3]])
    velocities = np.array([[12.0, 9.0, 3.4], [-12.0, 4.0, -2.6]])
    position = _cubics(np.array([0.0, FLIGHT_TIME]), places, velocities)
    return PaperScene(orientation, position, SweptPoses(places, keys))


def boomerang() -> list[Face]:
    """Return the faces of the body of Fig. 7: a boomerang about its centre of mass."""
    spread, length, width = np.radians(112.0), 0.62, 0.1
    half = 0.5 * spread
    arms = []
    for side in (1.0, -1.0):
        along = np.array([np.cos(half), side * np.sin(half)])
        across = np.array([-along[1], along[0]]) * side
        tip = length * along
        bow = [
            tip + 0.5 * width * (np.cos(a) * across * -1.0 + np.sin(a) * along)
            for a in np.linspace(0.0, np.pi, 7)
        ]
        arms.append(np.array(bow))
    inside = np.array([[width / (2.0 * np.sin(half)), 0.0]])
    outside = np.array([[-width / (2.0 * np.sin(half)), 0.0]])
    outline = np.concatenate([outside, arms[1][::-1], inside, arms[0]])
    centred = outline - np.array([0.45 * length * np.cos(half), 0.0])
    return prism(1.9 * centred, 0.05)


def cross_section() -> Floats:
    """Return the closed outline that Fig. 9 sweeps, in the body's y-z plane, shape ``(k, 3)``."""
    around = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    radius = 0.34 + 0.09 * np.cos(3.0 * around)
    return np.stack(
        [np.zeros_like(around), 1.25 * radius * np.cos(around), radius * np.sin(around)], axis=-1
    )
