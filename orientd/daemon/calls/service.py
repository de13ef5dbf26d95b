"""The gRPC service ``orientd.v1.Control`` in front of a cell.

Nothing that plans, commands or waits for a device happens in the event loop.
"""

from orientd.daemon.calls.commanding import CommandingCalls
from orientd.daemon.calls.leasing import LeasingCalls
from orientd.daemon.calls.moving import MovingCalls
from orientd.daemon.calls.tracking import TrackingCalls
from orientd.daemon.calls.watching import WatchingCalls
from orientd.rpc.control_pb2_grpc import ControlServicer


class ControlService(
    WatchingCalls, MovingCalls, TrackingCalls, CommandingCalls, LeasingCalls, ControlServicer
):
    """What the control socket offers."""
