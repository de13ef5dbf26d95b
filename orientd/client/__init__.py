"""The Python client: connect to a daemon, and command and watch its devices.

For packages that make motion requests of their own: ``motion_request``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.client.channel import Way, certificate_files, default_socket, found_socket, target
    from orientd.client.clutch import Anchor, Clutch
    from orientd.client.connection import Connection, StartAt
    from orientd.client.daemon_clock import DRIFT, Offset, Trip, clock_offset
    from orientd.client.endless_turn import EndlessTurn
    from orientd.client.motion_request import RequestFields
    from orientd.client.move_handle import MoveHandle
    from orientd.client.observer import Configuration, Observer
    from orientd.client.playing import Playing, PlayTiming
    from orientd.client.pointing import BaseReport, Pointing
    from orientd.client.robot import Robot, after_stop, connect
    from orientd.client.smoothing import smoothed_orientations, smoothed_positions
    from orientd.client.stop_call import ask_to_stop, check_answered
    from orientd.client.target_messages import TARGET_KEYS, target_message
    from orientd.client.teaching import MeasuredPose, Teaching
    from orientd.client.tracking import Tracking
    from orientd.client.trust import check_folder

__getattr__ = lazily(
    __name__,
    {
        "orientd.client.channel": (
            "Way",
            "certificate_files",
            "default_socket",
            "found_socket",
            "target",
        ),
        "orientd.client.clutch": ("Anchor", "Clutch"),
        "orientd.client.connection": ("Connection", "StartAt"),
        "orientd.client.daemon_clock": ("DRIFT", "Offset", "Trip", "clock_offset"),
        "orientd.client.endless_turn": ("EndlessTurn",),
        "orientd.client.motion_request": ("RequestFields",),
        "orientd.client.move_handle": ("MoveHandle",),
        "orientd.client.observer": ("Configuration", "Observer"),
        "orientd.client.playing": ("PlayTiming", "Playing"),
        "orientd.client.pointing": ("BaseReport", "Pointing"),
        "orientd.client.robot": ("Robot", "after_stop", "connect"),
        "orientd.client.stop_call": ("ask_to_stop", "check_answered"),
        "orientd.client.target_messages": ("TARGET_KEYS", "target_message"),
        "orientd.client.teaching": ("MeasuredPose", "Teaching"),
        "orientd.client.smoothing": ("smoothed_orientations", "smoothed_positions"),
        "orientd.client.tracking": ("Tracking",),
        "orientd.client.trust": ("check_folder",),
    },
)
