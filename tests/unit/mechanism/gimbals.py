"""Gimbals for the tests, with their axes called pan, tilt and roll."""

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.arrays import of_arrays, orientations
from orientd.mechanism.gimbal import Gimbal

NAMES = ("pan", "tilt", "roll")
WIDE = [AxisLimits(name, -10.0, 10.0, 10.0, 100.0) for name in NAMES]


def limits(order, velocity=3.85, acceleration=40.0, turns=(270, 200, 200)):
    return [
        AxisLimits(name, -np.deg2rad(most), np.deg2rad(most), velocity, acceleration)
        for most, name in zip(turns, NAMES, strict=True)
    ][: len(order)]


def gimbal_of(order, *, axes=None, **options):
    return Gimbal(WIDE[: len(order)] if axes is None else axes, order=order, **options)


def forward(gimbal, joints):
    """The orientations that axis angles make, ``(..., axes)`` to ``(..., 4)``."""
    return orientations(gimbal, joints)


def inverse(gimbal, q, inner=0.0):
    """Both branches of orientations, ``(n, 4)`` to ``(n, 2, axes)``, in (-pi, pi]."""
    last = (inner,) * len(gimbal.axes)
    found = np.array([gimbal.branches(tuple(one), last) for one in np.asarray(q).tolist()])
    return found - 2 * np.pi * np.ceil((found - np.pi) / (2 * np.pi))


def manipulability(gimbal, joints):
    return of_arrays(gimbal).manipulability(np.moveaxis(np.asarray(joints), -1, 0))
