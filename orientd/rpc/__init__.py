"""The control socket: protocol, conversions, errors on the wire, and the Python client."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.rpc.channel import Way, certificate_files, default_socket, found_socket, target
    from orientd.rpc.client import Robot, after_stop, connect
    from orientd.rpc.connection import Connection, StartAt
    from orientd.rpc.endless_turn import EndlessTurn
    from orientd.rpc.limits import limits_from_message, limits_to_message, limits_to_wish
    from orientd.rpc.motion import from_request, to_request
    from orientd.rpc.move_handle import MoveHandle
    from orientd.rpc.observer import Configuration, Observer
    from orientd.rpc.reports import (
        GOOD_OUTCOMES,
        STALE,
        CellReport,
        Outline,
        Samples,
        outline,
        plain,
        samples,
        titled,
        word,
    )
    from orientd.rpc.status import DETAILS_KEY, to_status
    from orientd.rpc.stop_call import ask_to_stop
    from orientd.rpc.targets import target_from_message
    from orientd.rpc.teaching import MeasuredPose, Teaching
    from orientd.rpc.tracking import TARGET_KEYS, target_message
    from orientd.rpc.trust import check_folder
    from orientd.rpc.values import quaternion, to_quaternion, to_vector, vector

__getattr__ = lazily(
    __name__,
    {
        "orientd.rpc.channel": (
            "Way",
            "certificate_files",
            "default_socket",
            "found_socket",
            "target",
        ),
        "orientd.rpc.client": ("Robot", "after_stop", "connect"),
        "orientd.rpc.connection": ("Connection", "StartAt"),
        "orientd.rpc.move_handle": ("MoveHandle",),
        "orientd.rpc.observer": ("Configuration", "Observer"),
        "orientd.rpc.reports": (
            "GOOD_OUTCOMES",
            "STALE",
            "CellReport",
            "Outline",
            "Samples",
            "outline",
            "plain",
            "samples",
            "titled",
            "word",
        ),
        "orientd.rpc.stop_call": ("ask_to_stop",),
        "orientd.rpc.teaching": ("MeasuredPose", "Teaching"),
        "orientd.rpc.endless_turn": ("EndlessTurn",),
        "orientd.rpc.tracking": ("TARGET_KEYS", "target_message"),
        "orientd.rpc.trust": ("check_folder",),
        "orientd.rpc.limits": ("limits_from_message", "limits_to_message", "limits_to_wish"),
        "orientd.rpc.motion": ("from_request", "to_request"),
        "orientd.rpc.status": ("DETAILS_KEY", "to_status"),
        "orientd.rpc.targets": ("target_from_message",),
        "orientd.rpc.values": ("quaternion", "to_quaternion", "to_vector", "vector"),
    },
)
