"""Looking at three dimensions: orthographic projection onto the sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.rotation import Floats


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Where the eye is: infinitely far away, the world's z axis upright.

    Attributes:
        elevation: of the eye above the world's x-y plane, degrees.
        azimuth: of the eye about the world's z axis from x on, degrees.
    """

    elevation: float = 24.0
    azimuth: float = 35.0

    @property
    def frame(self) -> Floats:
        """The directions rightwards, upwards and towards the eye, one a row."""
        tilt, turn = np.radians([self.elevation, self.azimuth])
        ct, st, ca, sa = np.cos(tilt), np.sin(tilt), np.cos(turn), np.sin(turn)
        return np.array([[-sa, ca, 0.0], [-st * ca, -st * sa, ct], [ct * ca, ct * sa, st]])

    def project(self, points: Floats) -> Floats:
        """Return right, up and nearness to the eye of *points*, shape ``(..., 3)`` both ways.

        >>> view = Viewpoint(elevation=0.0, azimuth=0.0)
        >>> view.project(np.array([0.5, 1.0, 2.0])).round(12).tolist()
        [1.0, 2.0, 0.5]
        """
        projected: Floats = points @ self.frame.T
        return projected


STANDARD_VIEW = Viewpoint()
"""From which everything is seen unless another view shows more."""
