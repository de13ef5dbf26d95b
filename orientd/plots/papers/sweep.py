"""Bodies and cross-sections along a rigid motion, as in Kim, Kim and Shin (1995), Figs. 7 to 10.

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
OUTSIDE_TINT = np.array([0.24, 0.62, 0.49])
INSIDE_TINT = np.array([0.93, 0.62, 0.42])
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
                tints.append(_lit(_normal(corner), tint))
    _paint(axes, corners, tints, view, edge=(0.25, 0.25, 0.25, 0.55), width=0.4)
    seen = view.project(trail)
    axes.plot(seen[:, 0], seen[:, 1], color=INK, linewidth=0.9, linestyle=(0.0, (4.0, 2.0)))


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
            outwards = _normal(quad)
            # Where the section moves backwards the surface is traversed the other way round.
            outwards *= 1.0 if float(outwards @ (quad.mean(axis=0) - centre)) >= 0.0 else -1.0
            is_outside = float(outwards @ view.frame[2]) > 0.0
            corners.append(quad)
            tints.append(
                _lit(
                    outwards if is_outside else -outwards,
                    OUTSIDE_TINT if is_outside else INSIDE_TINT,
                )
            )
    _paint(axes, corners, tints, view, edge=None, width=0.35)
    for ring in (rings[0], rings[-1]):
        seen = view.project(np.concatenate([ring, ring[:1]]))
        axes.plot(seen[:, 0], seen[:, 1], color=INK, linewidth=1.1)


def _normal(corners: Floats) -> Floats:
    """Return the unit normal of a face by Newell's sum over its edges."""
    following = np.roll(corners, -1, axis=0)
    normal: Floats = np.sum(np.cross(corners, following), axis=0)
    length = float(np.linalg.norm(normal))
    return normal / length if length > 0.0 else normal


def _lit(normal: Floats, tint: Floats) -> Floats:
    shade = 0.72 + 0.28 * float(normal @ LIGHT) / float(np.linalg.norm(LIGHT))
    lit: Floats = np.clip(tint * shade, 0.0, 1.0)
    return lit


def _paint(
    axes: Axes,
    corners: list[Floats],
    tints: list[Floats],
    view: Viewpoint,
    *,
    edge: tuple[float, float, float, float] | None,
    width: float,
) -> None:
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
