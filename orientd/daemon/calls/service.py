"""The gRPC service ``orientd.v1.Control`` in front of a cell.

Nothing that plans, commands or waits for a device happens in the event loop.
"""

from __future__ import annotations

from collections.abc import Mapping

from google.protobuf import message_factory

from orientd.daemon.access import Method
from orientd.daemon.calls.commanding import CommandingCalls
from orientd.daemon.calls.leasing import LeasingCalls
from orientd.daemon.calls.moving import MovingCalls
from orientd.daemon.calls.tracking import TrackingCalls
from orientd.daemon.calls.watching import WatchingCalls
from orientd.rpc import control_pb2 as pb

CONTROL = pb.DESCRIPTOR.services_by_name["Control"]


class ControlService(WatchingCalls, MovingCalls, TrackingCalls, CommandingCalls, LeasingCalls):
    """What the control socket offers."""

    def methods(self) -> Mapping[str, Method]:
        """Return every call by its full name."""
        return {
            f"/{CONTROL.full_name}/{one.name}": Method(
                one.name,
                getattr(self, one.name),
                message_factory.GetMessageClass(one.input_type),
                takes_stream=one.client_streaming,
                gives_stream=one.server_streaming,
            )
            for one in CONTROL.methods
        }
