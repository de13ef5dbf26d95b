"""Plan motions: from a request to an immutable :class:`Motion` with its certificate.

Start with :func:`plan`.  A request checks itself when it is made.  The :class:`Certificate` of a
motion has the properties that it guarantees.

Names load on first use: limits need none of the planning modules, and a daemon that has not planned
yet stays small.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.driver import Quaternion, Vector3
    from orientd.model import (
        ANGULAR,
        AXES,
        DEFAULT_LIMITS,
        DEFAULT_METHOD,
        NO_AXES,
        UNITS,
        Frame,
        Keyframe,
        Limits,
        MotionRequest,
        Pose,
        Rate,
        named_frames,
    )
    from orientd.planner.blending import NOT_BLENDED, blend
    from orientd.planner.certify.certificate import Certificate, Peak
    from orientd.planner.device_planner import DevicePlanner
    from orientd.planner.facts import HISTORY, MOTION_RECORD, MotionFacts
    from orientd.planner.fitting import reshaped
    from orientd.planner.methods import check_method, curve_of
    from orientd.planner.motion import Motion
    from orientd.planner.offline import in_parallel, need_backend, plan_many
    from orientd.planner.path.path import PathSamples
    from orientd.planner.path.position import position_path
    from orientd.planner.planning import plan
    from orientd.planner.recorded import RecordedMotion, rows_of, start_of, states_between
    from orientd.planner.resolve import in_device_coordinates, report_frame
    from orientd.planner.state import State
    from orientd.planner.task import distinct, plan_as_recorded, replay_request, task_of

__getattr__ = lazily(
    __name__,
    {
        "orientd.driver": ("Quaternion", "Vector3"),
        "orientd.model": (
            "ANGULAR",
            "AXES",
            "DEFAULT_LIMITS",
            "DEFAULT_METHOD",
            "NO_AXES",
            "UNITS",
            "Frame",
            "Keyframe",
            "Limits",
            "MotionRequest",
            "Pose",
            "Rate",
            "named_frames",
        ),
        "orientd.planner.fitting": ("reshaped",),
        "orientd.planner.blending": ("NOT_BLENDED", "blend"),
        "orientd.planner.certify.certificate": ("Certificate", "Peak"),
        "orientd.planner.device_planner": ("DevicePlanner",),
        "orientd.planner.facts": ("HISTORY", "MOTION_RECORD", "MotionFacts"),
        "orientd.planner.methods": ("check_method", "curve_of"),
        "orientd.planner.motion": ("Motion",),
        "orientd.planner.offline": ("in_parallel", "need_backend", "plan_many"),
        "orientd.planner.path.path": ("PathSamples",),
        "orientd.planner.path.position": ("position_path",),
        "orientd.planner.planning": ("plan",),
        "orientd.planner.recorded": ("RecordedMotion", "rows_of", "start_of", "states_between"),
        "orientd.planner.resolve": ("in_device_coordinates", "report_frame"),
        "orientd.planner.state": ("State",),
        "orientd.planner.task": ("distinct", "plan_as_recorded", "replay_request", "task_of"),
    },
)
