"""Bodies along a rigid motion, as in Kim, Kim and Shin (1995), Figs. 7, 8 and 10.

Faces are drawn from the farthest to the nearest, lit from one side, over their shadow on a floor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from orientd.plots.paper import INK
from orientd.plots.view import Viewpoint
from orientd.rotation import Floats, rotate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LIGHT = np.array([0.35, -0.45, 0.82])
KEYFRAME_TINT = np.array([0.10, 0.24, 0.48])
BETWEEN_TINT = np.array([0.80, 0.86, 0.93])
SHADOW = "#e4e2dc"
GAP = 0.08
"""From the lowest point to the floor, as a share of the height of everything."""

Face = Floats
"""Corners in order, counterclockwise seen from outside, shape ``(k, 3)``."""


@dataclass(frozen=True, slots=True, eq=False)
class SweptPoses:
    """Positions and orientations of a body.

    Attributes:
        positions: m, shape ``(n, 3)``.
        q: body to world, shape ``(n, 4)``.
    """

    positions: Floats
    q: Floats

    def placed(self, points: Floats) -> Floats:
        """Return *points* of the body, ``(k, 3)``, in the world at every pose, ``(n, k, 3)``."""
        turned = rotate(self.q[:, None, :], points[None, :, :])
        return turned + self.positions[:, None, :]


def prism(outline: Floats, thickness: float) -> list[Face]:
    """Return the faces of a plate over *outline* (counterclockwise, ``(k, 2)``) in the x-y plane.

    >>> len(prism(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), 0.1))
    5
    """
    half = 0.5 * thickness
    top = np.column_stack([outline, np.full(len(outline), half)])
    bottom = np.column_stack([outline, np.full(len(outline), -half)])
    sides = [np.stack([bottom[k - 1], bottom[k], top[k], top[k - 1]]) for k in range(len(outline))]
    return [top, bottom[::-1], *sides]


def plate() -> list[Face]:
    """Return the faces of the body of Figs. 8 and 10: a plate across the body's x axis."""
    outline = np.array([[-0.62, -0.36], [0.62, -0.36], [0.62, 0.36], [-0.62, 0.36]])
    # x, y, z to y, z, x: a turn, so that faces keep facing outwards.
    return [face[:, [2, 0, 1]] for face in prism(outline, 0.09)]


def draw_bodies(
    axes: Axes,
    faces: list[Face],
    between: SweptPoses,
    keyframes: SweptPoses,
    view: Viewpoint,
    trail: Floats,
) -> None:
    """Draw a body at many poses, dark at the keyframes.

    Args:
        axes: an empty chart.
        faces: of the body.
        between: where it is drawn light.
        keyframes: where it is drawn dark.
        view: where the eye is.
        trail: positions along the motion, drawn as a line, shape ``(m, 3)``.
    """
    corners: list[Floats] = []
    tints: list[Floats] = []
    for poses, tint in ((between, BETWEEN_TINT), (keyframes, KEYFRAME_TINT)):
        for face in faces:
            for corner in poses.placed(face):
                corners.append(corner)
                tints.append(lit(face_normal(corner), tint))
    paint_faces(axes, corners, tints, view, edge=(0.25, 0.25, 0.25, 0.55), width=0.4)
    seen = view.project(trail)
    axes.plot(seen[:, 0], seen[:, 1], color=INK, linewidth=0.9, linestyle=(0.0, (4.0, 2.0)))


def face_normal(corners: Floats) -> Floats:
    """Return the unit normal of a face by Newell's sum over its edges."""
    following = np.roll(corners, -1, axis=0)
    normal: Floats = np.sum(np.cross(corners, following), axis=0)
    length = float(np.linalg.norm(normal))
    return normal / length if length > 0.0 else normal


def lit(normal: Floats, tint: Floats) -> Floats:
    """Return the colour of a face with a *normal*, red, green and blue from 0 to 1."""
    shade = 0.72 + 0.28 * float(normal @ LIGHT) / float(np.linalg.norm(LIGHT))
    lit: Floats = np.clip(tint * shade, 0.0, 1.0)
    return lit


def paint_faces(
    axes: Axes,
    corners: list[Floats],
    tints: list[Floats],
    view: Viewpoint,
    *,
    edge: tuple[float, float, float, float] | None,
    width: float,
) -> None:
    """Draw faces from the farthest to the nearest, over their shadow on a floor.

    Args:
        axes: the chart.
        corners: of the faces, each of shape ``(k, 3)``.
        tints: their colours.
        view: where the eye is.
        edge: colour of their edges; ``None`` for that of each face.
        width: of their edges, points.
    """
    from matplotlib.collections import PolyCollection

    everything = np.concatenate(corners)
    lowest, highest = float(everything[:, 2].min()), float(everything[:, 2].max())
    floor = lowest - GAP * max(highest - lowest, 1e-9)
    shadows = []
    for corner in corners:
        flat = corner - np.outer((corner[:, 2] - floor) / LIGHT[2], LIGHT)
        shadows.append(view.project(flat)[:, :2])
    axes.add_collection(
        PolyCollection(shadows, facecolors=SHADOW, edgecolors=SHADOW, linewidths=0.5, zorder=0.5)
    )
    projected = [view.project(corner) for corner in corners]
    order = np.argsort([float(seen[:, 2].mean()) for seen in projected])
    colours = [tuple(tints[k]) for k in order]
    axes.add_collection(
        PolyCollection(
            [projected[k][:, :2] for k in order],
            facecolors=colours,
            edgecolors=colours if edge is None else [edge],
            linewidths=width,
            joinstyle="round",
            zorder=1.0,
            gid="faces",
        )
    )
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.autoscale_view()
