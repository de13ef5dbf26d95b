"""Values on the wire: from messages and to messages, errors included."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.rpc.wire.limits import limits_message
    from orientd.rpc.wire.motion import from_request
    from orientd.rpc.wire.move import (
        plan_from_message,
        progress_from_message,
        samples_from_messages,
        summary_from_message,
        timing_from_message,
    )
    from orientd.rpc.wire.state import (
        configured_from_message,
        cycle_from_message,
        daemon_from_message,
        device_from_message,
        method_from_message,
        outline_from_messages,
    )
    from orientd.rpc.wire.status import DETAILS_KEY, from_status
    from orientd.rpc.wire.track import report_from_message, target_to_message

__getattr__ = lazily(
    __name__,
    {
        "orientd.rpc.wire.limits": ("limits_message",),
        "orientd.rpc.wire.motion": ("from_request",),
        "orientd.rpc.wire.move": (
            "plan_from_message",
            "progress_from_message",
            "samples_from_messages",
            "summary_from_message",
            "timing_from_message",
        ),
        "orientd.rpc.wire.state": (
            "configured_from_message",
            "cycle_from_message",
            "daemon_from_message",
            "device_from_message",
            "method_from_message",
            "outline_from_messages",
        ),
        "orientd.rpc.wire.status": (
            "DETAILS_KEY",
            "from_status",
        ),
        "orientd.rpc.wire.track": (
            "report_from_message",
            "target_to_message",
        ),
    },
)
