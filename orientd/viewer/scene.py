"""The scene: the tool's axes as sent and as measured, the planned path, the device.

One unit is a metre.  The sphere that the tips of the axes move on is about the tool.
"""

from __future__ import annotations

import colorsys
import math
from typing import Any

import numpy as np
import viser

from orientd.rotation import Floats
from orientd.rpc import Outline, Plan, Samples
from orientd.stream import Cycle
from orientd.viewer import geometry

RADIUS = 0.3
"""Of the sphere, m."""

COLOURS = ((214, 84, 44), (46, 158, 114), (66, 112, 216))
"""Of x, y and z; readable on white and on black."""

_QUIET = (128, 128, 128)
_DEVICE = (110, 118, 130)
_KEYFRAMES_ON_ALL_AXES = 12
_MOST_NUMBERS = 60

TO_AXIS = ((0.5**0.5, 0.0, 0.5**0.5, 0.0), (0.5**0.5, -(0.5**0.5), 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
"""From z, which meshes are about, to each axis."""


PANEL_WIDTH, PANEL_HEIGHT = 0.33, 0.6
"""Share of the page that the panel takes: at the right, or of an upright page at the bottom.

Shares, as sizes are told in pixels of the screen, of which one on the page may have several.
"""

UPRIGHT_DISTANCE = 1.9
"""How much farther away one looks from on an upright page, which is narrow."""


def aim(camera: viser.CameraHandle, target: Floats, away: Floats) -> None:
    """Look at *target*, so that it is in the middle of what the panel leaves free.

    Args:
        camera: of one browser.
        target: m.
        away: from there to where one looks from, on a page that is not upright, m.
    """
    width, height = camera.image_width, max(camera.image_height, 1)
    is_upright = height > width
    away = away * UPRIGHT_DISTANCE if is_upright else away
    metres_per_pixel = 2.0 * np.linalg.norm(away) * math.tan(0.5 * camera.fov) / height
    right = np.cross((0.0, 0.0, 1.0), away)
    up = np.cross(away, right)
    if is_upright:
        shift = -0.5 * PANEL_HEIGHT * height * metres_per_pixel * up / np.linalg.norm(up)
    else:
        shift = 0.5 * PANEL_WIDTH * width * metres_per_pixel * right / np.linalg.norm(right)
    camera.up_direction = (0.0, 0.0, 1.0)
    camera.position = target + away + shift
    camera.look_at = target + shift


class Scene:
    """What is drawn, and how it moves."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Draw everything that is always there."""
        self._scene = scene = server.scene
        self._tool = scene.add_frame("/tool", show_axes=False)
        scene.add_icosphere(
            "/tool/sphere", RADIUS, _QUIET, opacity=0.07, side="back", cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        for axis in range(3):
            ring = geometry.circle(axis) * RADIUS
            scene.add_line_segments(
                f"/tool/ring_{axis}", geometry.segments(ring), _QUIET, thickness=0.0012
            )
        self._sent = scene.add_frame("/tool/sent", show_axes=False)
        self._measured = scene.add_frame("/measured", show_axes=False, visible=False)
        self._triads()
        self._body = scene.add_box(
            "/measured/body", _DEVICE, dimensions=(0.16, 0.1, 0.03), cast_shadow=False
        )
        self._floor = scene.add_grid(
            "/floor", 3.0, 3.0, cell_size=0.1, section_size=0.5, fade_distance=4.0,
            cell_color=_QUIET, section_color=_QUIET, cell_thickness=0.5, shadow_opacity=0.0,
            position=(0.0, 0.0, -1.3 * RADIUS),
        )  # fmt: skip
        self._device: Any = None
        self._joints: Any = None
        self._shown: tuple[Any, ...] = ()
        self._outline: Outline = ()
        self._paths: dict[str, str] = {}
        self._parts: dict[str, list[Any]] = {}

    def _triads(self) -> None:
        scene = self._scene
        vertices, faces = geometry.arrow(RADIUS, 0.006)
        sheath, sheath_faces = geometry.tube(0.045, 0.78 * RADIUS, 0.017)
        collar, collar_faces = geometry.tube(0.76 * RADIUS, 0.78 * RADIUS, 0.019)
        for axis, (name, colour) in enumerate(zip(geometry.AXES, COLOURS, strict=True)):
            wxyz, tip = TO_AXIS[axis], np.eye(3)[axis]
            scene.add_mesh_simple(
                f"/tool/sent/{name}", vertices, faces, color=colour, wxyz=wxyz, cast_shadow=False
            )
            scene.add_mesh_simple(
                f"/measured/{name}", sheath, sheath_faces, color=colour, wxyz=wxyz, opacity=0.35,
                side="double", cast_shadow=False,
            )  # fmt: skip
            scene.add_mesh_simple(
                f"/measured/{name}_end", collar, collar_faces, color=colour, wxyz=wxyz,
                cast_shadow=False,
            )  # fmt: skip
            scene.add_label(
                f"/tool/sent/{name}_label", f"{name} sent", position=1.1 * RADIUS * tip,
                anchor="center-center",
            )  # fmt: skip
        scene.add_label(
            "/measured/label", "measured", position=(0.0, 0.0, 0.6 * RADIUS),
            anchor="center-left", font_screen_scale=0.8,
        )  # fmt: skip

    @property
    def has_device(self) -> bool:
        """Whether the device has a shape of its own."""
        return bool(self._outline)

    def move(self, cycle: Cycle | None, outline: Outline) -> None:
        """Move everything to where it was in *cycle*; nothing is done where nothing has moved."""
        if cycle is not None:
            shown = (cycle.q, cycle.position, cycle.feedback_q, cycle.feedback_position,
                     cycle.has_feedback)  # fmt: skip
            if shown != self._shown:
                self._shown = shown
                self._sent.wxyz = cycle.q
                self._tool.position = cycle.position
                self._measured.visible = cycle.has_feedback
                if cycle.has_feedback:
                    self._measured.wxyz = cycle.feedback_q
                    self._measured.position = cycle.feedback_position
        self._draw_device(outline)

    def _draw_device(self, outline: Outline) -> None:
        if len(outline) == len(self._outline) and all(map(np.array_equal, outline, self._outline)):
            return
        if bool(outline) != bool(self._outline):
            self._body.visible = not outline
            self._floor.position = (0.0, 0.0, 0.0 if outline else -1.3 * RADIUS)
        self._outline = outline
        for handle in (self._device, self._joints):
            if handle is not None:
                handle.visible = bool(outline)
        if not outline:
            return
        lines = np.concatenate([geometry.segments(line) for line in outline]).astype(np.float32)
        corners = np.concatenate([line for line in outline if len(line) <= 8]).astype(np.float32)
        if self._device is None:
            self._device = self._scene.add_line_segments("/device", lines, _DEVICE, thickness=0.03)
            self._joints = self._scene.add_point_cloud(
                "/joints", corners, _DEVICE, point_size=0.028, point_shape="circle",
                precision="float32",
            )  # fmt: skip
        self._device.points = lines
        self._device.thickness = 0.05 if np.ptp(lines) > 0.6 else 0.008
        self._joints.points = corners
        self._joints.point_size = 0.04 if np.ptp(lines) > 0.6 else 0.008

    # Paths

    def show_path(self, name: str, plan: Plan | None, *, prefix: str = "") -> None:
        """Draw the path of *plan* in the place of the one called *name*; ``None`` for none.

        Args:
            name: of the path.
            plan: with its samples.
            prefix: of the numbers of its keyframes.
        """
        motion_id = plan.motion_id if plan is not None and plan.samples is not None else ""
        if self._paths.get(name, "") == motion_id:
            return
        self._paths[name] = motion_id
        for handle in self._parts.pop(name, []):
            handle.remove()
        if plan is not None and plan.samples is not None:
            self._parts[name] = self._draw_path(f"/tool/{name}", plan, plan.samples, prefix)

    def _draw_path(self, root: str, plan: Plan, samples: Samples, prefix: str) -> list[Any]:
        handles: list[Any] = []
        traces = geometry.tips(samples.q)
        keys = geometry.tips(geometry.keyframe_orientations(plan, samples))
        for axis, (name, colour) in enumerate(zip(geometry.AXES, COLOURS, strict=True)):
            strokes = geometry.dashed(traces[axis], geometry.PATTERNS[axis]) * RADIUS
            if len(strokes):
                handles.append(
                    self._scene.add_line_segments(
                        f"{root}/{name}", strokes, _paler(colour) if prefix else colour,
                        thickness=0.003 if prefix else 0.005,
                    )
                )  # fmt: skip
            handles.append(
                self._scene.add_point_cloud(
                    f"{root}/{name}_keyframes", (keys[axis] * RADIUS).astype(np.float32), colour,
                    point_size=0.009, point_shape="circle", precision="float32",
                )
            )  # fmt: skip
        count = keys.shape[1]
        step = -(-count // (_KEYFRAMES_ON_ALL_AXES if count > _MOST_NUMBERS else _MOST_NUMBERS))
        axes = range(3) if count <= _KEYFRAMES_ON_ALL_AXES else range(1)
        for axis in axes:
            handles += self._numbers(f"{root}/{axis}", keys[axis], step, prefix)
        return handles

    def _numbers(self, root: str, keys: Floats, step: int, prefix: str) -> list[Any]:
        return [
            self._scene.add_label(
                f"{root}_{number}", f"{prefix}{number + 1}", position=1.07 * RADIUS * keys[number],
                anchor="center-center", font_screen_scale=0.8,
            )
            for number in range(0, len(keys), step)
        ]  # fmt: skip


def _paler(colour: tuple[int, int, int]) -> tuple[int, int, int]:
    hue, light, saturation = colorsys.rgb_to_hls(*(part / 255.0 for part in colour))
    red, green, blue = colorsys.hls_to_rgb(hue, 0.5 * (1.0 + light), 0.7 * saturation)
    return round(255 * red), round(255 * green), round(255 * blue)
