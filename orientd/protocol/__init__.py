"""The messages of the control socket, and what turns them into values and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.protocol.limits import (
        limits_from_message,
        limits_message,
        limits_to_message,
        limits_to_wish,
    )
    from orientd.protocol.motion import cone_message, from_request, to_cones, to_request
    from orientd.protocol.reports import (
        GOOD_OUTCOMES,
        STALE,
        CellReport,
        Outline,
        Samples,
        ending,
        last_ending,
        orientation,
        outline,
        plain,
        samples,
        titled,
        word,
    )
    from orientd.protocol.status import DETAILS_KEY, from_status, to_status
    from orientd.protocol.stub import control_stub
    from orientd.protocol.targets import (
        LONGEST_AGO,
        LONGEST_AHEAD,
        LONGEST_LIFE,
        check_chunk_times,
        pose_problem,
        poses_from_message,
        stamp_problem,
        target_from_message,
    )
    from orientd.protocol.values import quaternion, to_quaternion, to_vector, vector

__getattr__ = lazily(
    __name__,
    {
        "orientd.protocol.limits": (
            "limits_from_message",
            "limits_message",
            "limits_to_message",
            "limits_to_wish",
        ),
        "orientd.protocol.motion": ("cone_message", "from_request", "to_cones", "to_request"),
        "orientd.protocol.reports": (
            "GOOD_OUTCOMES",
            "STALE",
            "CellReport",
            "Outline",
            "Samples",
            "ending",
            "last_ending",
            "orientation",
            "outline",
            "plain",
            "samples",
            "titled",
            "word",
        ),
        "orientd.protocol.status": ("DETAILS_KEY", "from_status", "to_status"),
        "orientd.protocol.stub": ("control_stub",),
        "orientd.protocol.targets": (
            "LONGEST_AGO",
            "LONGEST_AHEAD",
            "LONGEST_LIFE",
            "check_chunk_times",
            "pose_problem",
            "poses_from_message",
            "stamp_problem",
            "target_from_message",
        ),
        "orientd.protocol.values": ("quaternion", "to_quaternion", "to_vector", "vector"),
    },
)
