"""Frames as a motion file and a configuration write them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from orientd import plain_values as plain
from orientd.errors import RequestError
from orientd.planner import Frame, Pose
from orientd.schema.orientations import DIRECTIONS, FORMS, quaternions, the_only

POSE_FORMS = tuple(form for form in FORMS if form not in DIRECTIONS)
"""How the orientation of a frame can be written."""

_POSE: dict[str, plain.Reader] = {
    **{form: FORMS[form] for form in POSE_FORMS},
    "position": plain.vector,
}


def read_frames(content: object) -> dict[str, Frame]:
    """Return frames by name."""
    read: dict[str, Frame] = {}
    for name, frame in plain.options(content).items():
        try:
            read[name] = Frame(**plain.keys(frame, {"base": _pose, "tool": _pose}, ()))
        except RequestError as error:
            raise plain.placed(name, error) from None
    return read


def written_frames(given: Mapping[str, Frame]) -> dict[str, Any]:
    """Return what :func:`read_frames` reads; what is as by default is left out."""
    usual = Frame()
    return {
        name: {
            part: _written(pose)
            for part, pose in (("base", frame.base), ("tool", frame.tool))
            if pose != getattr(usual, part)
        }
        for name, frame in given.items()
    }


def _written(pose: Pose) -> dict[str, Any]:
    return {
        "quaternion": dict(zip("wxyz", pose.q, strict=True)),
        "position": list(pose.position),
    }


def _pose(content: object) -> Pose:
    read = plain.keys(content, _POSE, ())
    position = read.pop("position", Pose().position)
    if not read:
        return Pose(position=position)
    try:
        (q,) = quaternions([the_only(read)])
    except RequestError as error:
        # Of a list of one that nobody has written.
        raise RequestError(error.field.removeprefix("[0]."), error.problem) from None
    return Pose(q, position)
