"""The surface that a cross-section sweeps, as in Kim, Kim and Shin (1995), Fig. 9."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from orientd.plots.bodies import SweptPoses, face_normal, lit, paint_faces
from orientd.plots.paper import INK
from orientd.plots.view import Viewpoint
from orientd.rotation import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OUTSIDE_TINT = np.array([0.24, 0.62, 0.49])
INSIDE_TINT = np.array([0.93, 0.62, 0.42])


def draw_sweep(axes: Axes, section: Floats, poses: SweptPoses, view: Viewpoint) -> None:
    """Draw the surface that a closed cross-section sweeps.

    Args:
        axes: an empty chart.
        section: corners in the body's frame, in order, shape ``(k, 3)``.
        poses: close together along the motion.
        view: where the eye is.
    """
    rings = poses.placed(section)
    corners: list[Floats] = []
    tints: list[Floats] = []
    centres = rings.mean(axis=1)
    for first, second, centre in zip(rings[:-1], rings[1:], centres, strict=False):
        for k in range(len(section)):
            quad = np.stack([first[k - 1], first[k], second[k], second[k - 1]])
            outwards = face_normal(quad)
            # Where the section moves backwards the surface is traversed the other way round.
            outwards *= 1.0 if float(outwards @ (quad.mean(axis=0) - centre)) >= 0.0 else -1.0
            is_outside = float(outwards @ view.frame[2]) > 0.0
            corners.append(quad)
            tints.append(
                lit(
                    outwards if is_outside else -outwards,
                    OUTSIDE_TINT if is_outside else INSIDE_TINT,
                )
            )
    paint_faces(axes, corners, tints, view, edge=None, width=0.35)
    for ring in (rings[0], rings[-1]):
        seen = view.project(np.concatenate([ring, ring[:1]]))
        axes.plot(seen[:, 0], seen[:, 1], color=INK, linewidth=1.1)
