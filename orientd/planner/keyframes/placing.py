"""From a request in frames, or relative to where the device is, to one in device coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from orientd.errors import RequestError
from orientd.planner.keyframes.pointing import pointed
from orientd.planner.request import Frame, Keyframe, MotionRequest, Pose, State, Vector3
from orientd.rotation import Floats, conjugate, multiply, normalize, rotate

_DEVICE = Frame()


def with_frames(request: MotionRequest, frames: Mapping[str, Frame]) -> MotionRequest:
    """Return *request* with the frames that it may name; its own come before those of *frames*."""
    return replace(request, frames={**frames, **request.frames}) if frames else request


def report_frame(request: MotionRequest) -> Frame | None:
    """Return the frame that reports of a motion are in: its own, or the only one of its keyframes.

    ``None`` are the coordinates of the device.

    Raises:
        RequestError: there is no such frame.
    """
    name = request.frame
    if not name:
        names = {keyframe.frame for keyframe in request.keyframes}
        name = names.pop() if len(names) == 1 else ""
    return _named(request, name, "frame") if name else None


def in_device_coordinates(request: MotionRequest, start: State | None) -> MotionRequest:
    """Return the same request as the device takes it: the flange in the world.

    Where a keyframe only says where to point, its roll is chosen here, since what points is an axis
    of its frame's tool.

    Args:
        request: with the frames that it names.
        start: where the device is commanded to be; ``None`` where that is not known.

    Raises:
        RequestError: there is no such frame; or a keyframe is relative, and *start* is not known.
    """
    if not (request.frames or _is_framed(request)):
        return request
    axis = np.eye(3)["xyz".index(request.pointing_axis)]
    before = None if start is None else start.q
    placed: list[Keyframe] = []
    places: list[tuple[Floats, Floats]] = []
    for index, keyframe in enumerate(request.keyframes):
        name, field = keyframe.frame or request.frame, f"keyframes[{index}].frame"
        frame = _named(request, name, field) if name else _DEVICE
        base, tool = frame.base, frame.tool
        if keyframe.relative:
            if start is None:
                problem = "where the device is, is not known here"
                raise RequestError(f"keyframes[{index}].relative", problem)
            base = _tool_at(start, tool)
        q_world_tool = multiply(base.q, request.keys[index])
        q = multiply(q_world_tool, conjugate(tool.q))
        if keyframe.free_roll:
            direction = rotate(q_world_tool, np.eye(3)[0])
            q = pointed(q if before is None else before, rotate(tool.q, axis), direction)
        before = normalize(q)
        places.append((np.array(base.q), np.array(tool.q)))
        placed.append(_placed(keyframe, before, base, tool))
    own = _named(request, request.frame, "frame") if request.frame else _DEVICE
    return replace(
        request,
        keyframes=placed,
        frame="",
        frames={},
        start_velocity=_turned(request, request.start_velocity, *places[0]),
        end_velocity=_turned(request, request.end_velocity, *places[-1]),
        rate=_turned(request, request.rate, np.array(own.base.q), np.array(own.tool.q)),
    )


def _is_framed(request: MotionRequest) -> bool:
    return bool(request.frame) or any(
        keyframe.frame or keyframe.relative for keyframe in request.keyframes
    )


def _named(request: MotionRequest, name: str, field: str) -> Frame:
    if name not in request.frames:
        known = ", ".join(request.frames)
        expected = f"expected one of {known}" if known else "there are no frames here"
        raise RequestError(field, f"{expected}, got {name!r}")
    return request.frames[name]


def _tool_at(start: State, tool: Pose) -> Pose:
    """Return where a tool is on a device that is commanded to be at *start*."""
    w, x, y, z = multiply(start.q, tool.q).tolist()
    a, b, c = (start.position + rotate(start.q, tool.position)).tolist()
    return Pose((w, x, y, z), (a, b, c))


def _placed(keyframe: Keyframe, q: Floats, base: Pose, tool: Pose) -> Keyframe:
    position = keyframe.position
    if position is not None:
        seen = np.array(base.position) + rotate(base.q, position)
        x, y, z = (seen - rotate(q, tool.position)).tolist()
        position = x, y, z
    w, x, y, z = q.tolist()
    return replace(
        keyframe, q=(w, x, y, z), position=position, frame="", relative=False, free_roll=False
    )


def _turned(
    request: MotionRequest, velocity: Vector3 | None, q_world_base: Floats, q_flange_tool: Floats
) -> Vector3 | None:
    """Return an angular velocity in coordinates of the flange, or of the world."""
    if velocity is None:
        return None
    by = q_flange_tool if request.velocity_frame == "body" else q_world_base
    x, y, z = rotate(by, velocity).tolist()
    return x, y, z
