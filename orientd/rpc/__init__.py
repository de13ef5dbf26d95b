"""The control socket: protocol, conversions, errors on the wire, and the Python client."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.rpc.address import default_socket, found_socket, target
    from orientd.rpc.channel import Way, certificate_files
    from orientd.rpc.client import Robot, connect, connect_by
    from orientd.rpc.commands import after_stop
    from orientd.rpc.connection import Connection, StartAt
    from orientd.rpc.descriptions import MethodDescription, Outline, PartReport
    from orientd.rpc.move_handle import MoveHandle
    from orientd.rpc.observer import Configuration, Observer
    from orientd.rpc.reports import (
        STALE,
        CellReport,
        DaemonReport,
        DeviceReport,
        Durations,
        LeaseReport,
        MoveTiming,
        OnTarget,
        Outcome,
        Plan,
        Progress,
        Samples,
        Statistics,
        Summary,
        TrackReport,
        titled,
    )
    from orientd.rpc.stop_call import ask_to_stop
    from orientd.rpc.tls_problem import verified
    from orientd.rpc.tracking import TARGET_KEYS, target_message
    from orientd.rpc.trust import check_folder
    from orientd.rpc.wire.limits import limits_to_wish
    from orientd.rpc.wire.motion import from_request, to_request
    from orientd.rpc.wire.move import (
        plan_to_message,
        progress_to_message,
        summary_to_message,
        timing_to_message,
    )
    from orientd.rpc.wire.state import (
        daemon_from_message,
        device_from_message,
        limits_to_message,
        method_to_message,
        outline_to_messages,
        tracking_error,
    )
    from orientd.rpc.wire.status import DETAILS_KEY, to_status
    from orientd.rpc.wire.track import report_to_message, target_from_message

__getattr__ = lazily(
    __name__,
    {
        "orientd.rpc.address": (
            "default_socket",
            "found_socket",
            "target",
        ),
        "orientd.rpc.channel": (
            "Way",
            "certificate_files",
        ),
        "orientd.rpc.client": (
            "Robot",
            "connect",
            "connect_by",
        ),
        "orientd.rpc.commands": ("after_stop",),
        "orientd.rpc.connection": (
            "Connection",
            "StartAt",
        ),
        "orientd.rpc.descriptions": (
            "MethodDescription",
            "Outline",
            "PartReport",
        ),
        "orientd.rpc.move_handle": ("MoveHandle",),
        "orientd.rpc.observer": (
            "Configuration",
            "Observer",
        ),
        "orientd.rpc.reports": (
            "STALE",
            "CellReport",
            "DaemonReport",
            "DeviceReport",
            "Durations",
            "LeaseReport",
            "MoveTiming",
            "OnTarget",
            "Outcome",
            "Plan",
            "Progress",
            "Samples",
            "Statistics",
            "Summary",
            "TrackReport",
            "titled",
        ),
        "orientd.rpc.stop_call": ("ask_to_stop",),
        "orientd.rpc.tls_problem": ("verified",),
        "orientd.rpc.tracking": (
            "TARGET_KEYS",
            "target_message",
        ),
        "orientd.rpc.trust": ("check_folder",),
        "orientd.rpc.wire.limits": ("limits_to_wish",),
        "orientd.rpc.wire.motion": (
            "from_request",
            "to_request",
        ),
        "orientd.rpc.wire.move": (
            "plan_to_message",
            "progress_to_message",
            "summary_to_message",
            "timing_to_message",
        ),
        "orientd.rpc.wire.state": (
            "daemon_from_message",
            "device_from_message",
            "limits_to_message",
            "method_to_message",
            "outline_to_messages",
            "tracking_error",
        ),
        "orientd.rpc.wire.status": (
            "DETAILS_KEY",
            "to_status",
        ),
        "orientd.rpc.wire.track": (
            "report_to_message",
            "target_from_message",
        ),
    },
)
