"""The model of a motion request, the same for a motion file, Python and a message."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.model.cones import read_cones, written_cone
    from orientd.model.fields import AngularRate, LinearRate
    from orientd.model.keyframes import keyframe_mappings
    from orientd.model.limits import (
        ACCELERATION_RESERVE,
        ANGULAR,
        AXES,
        DEFAULT_LIMITS,
        LONGEST,
        NO_AXES,
        PERIODS,
        STEADY,
        STILL,
        UNITS,
        Limits,
        Rate,
        angular_rate,
        is_still,
    )
    from orientd.model.orientation import FORMS
    from orientd.model.plain import joined, shown, to_plain
    from orientd.model.reading import read_frames, read_keyframe, read_request, written
    from orientd.model.request import (
        DEFAULT_METHOD,
        Frame,
        Keyframe,
        MotionRequest,
        Pace,
        Pose,
        named_frames,
    )
    from orientd.model.schema import attribute_lines, motion_schema

__getattr__ = lazily(
    __name__,
    {
        "orientd.model.cones": ("read_cones", "written_cone"),
        "orientd.model.fields": ("AngularRate", "LinearRate"),
        "orientd.model.keyframes": ("keyframe_mappings",),
        "orientd.model.limits": (
            "ACCELERATION_RESERVE",
            "ANGULAR",
            "AXES",
            "DEFAULT_LIMITS",
            "LONGEST",
            "NO_AXES",
            "PERIODS",
            "STEADY",
            "STILL",
            "UNITS",
            "Limits",
            "Rate",
            "angular_rate",
            "is_still",
        ),
        "orientd.model.orientation": ("FORMS",),
        "orientd.model.plain": ("joined", "shown", "to_plain"),
        "orientd.model.reading": ("read_frames", "read_keyframe", "read_request", "written"),
        "orientd.model.request": (
            "DEFAULT_METHOD",
            "Frame",
            "Keyframe",
            "MotionRequest",
            "Pace",
            "Pose",
            "named_frames",
        ),
        "orientd.model.schema": ("attribute_lines", "motion_schema"),
    },
)
