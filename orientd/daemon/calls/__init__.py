"""The calls of the gRPC service ``orientd.v1.Control``, by subject: messages in, messages out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.calls.commanding import CommandingCalls
    from orientd.daemon.calls.leasing import LeasingCalls
    from orientd.daemon.calls.moving import MovingCalls
    from orientd.daemon.calls.telemetry import Telemetry
    from orientd.daemon.calls.tracking import TrackingCalls
    from orientd.daemon.calls.unread import left_unread
    from orientd.daemon.calls.watching import WatchingCalls

__getattr__ = lazily(__name__)
