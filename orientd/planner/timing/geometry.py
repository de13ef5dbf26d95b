"""A keyframe path as the arrays that the kernels time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.planner.timing.candidate_path import KeyframePath
from orientd.rotation import Floats

_STILL = np.empty(0), np.empty((0, 18))


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """Orientation and position of a keyframe path, by path time from 0 on.

    Attributes:
        orientation: breaks and pieces of the trajectory, and the path times of its knots.
        moves: breaks and coefficients of the position, shape ``(m + 1,)`` and ``(m, 18)``.
    """

    orientation: tuple[Floats, Floats, Floats]
    moves: tuple[Floats, Floats]

    @classmethod
    def of(cls, path: KeyframePath) -> Geometry:
        """Return the geometry of a keyframe path."""
        trajectory, positions = path.trajectory, path.positions
        moves = _STILL
        if not positions.is_held:
            moves = positions.breaks, positions.coefficients.reshape(-1, 18)
        return cls((trajectory.breaks, trajectory.pieces, trajectory.knots), moves)

    @property
    def ends(self) -> Floats:
        """The path times of its beginning and its end, s, shape ``(2,)``."""
        return self.orientation[2][[0, -1]]
