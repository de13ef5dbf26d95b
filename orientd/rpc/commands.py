"""What a client has devices do, apart from motions: stop, pause, enable, reset and the like."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from orientd.errors import OrientdError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.connection import Connection
from orientd.rpc.lease_holder import LeaseHolder
from orientd.rpc.reports import DeviceReport
from orientd.rpc.stop_call import ask_to_stop
from orientd.rpc.wire import device_from_message

_REPORT_TIMEOUT = 1.0
"""How long the daemon may take to say how devices are that are stopped already, s."""

_OVER_GRPC = {"stop": ("Stop", pb.StopRequest), "halt": ("Halt", pb.HaltRequest)}


def stopped_message(told: Mapping[str, Any]) -> pb.DeviceReport:
    """Return what little is known of a device that was stopped while the daemon says nothing."""
    return pb.DeviceReport(
        device=pb.Device(name=told["name"]),
        state=f"STATE_{told['state']}",
        motion_number=told["motion"],
    )


def after_stop(connection: Connection, device: str) -> list[DeviceReport]:
    """Return how a device is that was stopped, or all of them if *device* is empty.

    Raises:
        OrientdError: the daemon does not say so in time.
    """
    request = pb.GetStateRequest(device=device)
    now = connection.call(connection.stub.GetState, request, timeout=_REPORT_TIMEOUT)
    return [device_from_message(one) for one in now.devices]


class Commands(LeaseHolder):
    """A client that commands devices; all but what stops them needs their leases."""

    @property
    def local_socket(self) -> Path | None:
        """The daemon's socket; ``None`` where it is asked by another way."""
        way = self._connection.way
        return None if way.address else way.socket

    def stop(self, device: str = "") -> list[DeviceReport]:
        """Bring a device, or all of them, to rest on the path.  Needs no lease.

        On the daemon's own machine this needs the daemon's answer neither, which is told of
        afterwards: where it hangs, what is returned says little more than what was stopped.

        Raises:
            AccessError: this user is not admitted.
            DaemonError: a servo does not answer, or nobody does.
        """
        return self._rest("stop", device)

    def halt(self, device: str = "") -> list[DeviceReport]:
        """Bring a device, or all of them, to rest as quickly as the limits allow.

        That may leave the path.  As for :meth:`stop`.
        """
        return self._rest("halt", device)

    def _rest(self, kind: str, device: str) -> list[DeviceReport]:
        connection, local = self._connection, self.local_socket
        told = None if local is None else ask_to_stop(local, kind, device)
        if told is None:
            method, request = _OVER_GRPC[kind]
            answer = connection.ask(
                getattr(self._stub, method), request(device=device, caller=self.holder)
            )
            return [device_from_message(one) for one in answer.devices]
        try:
            return after_stop(connection, device)
        except OrientdError:
            return [device_from_message(stopped_message(one)) for one in told]

    def pause(self, device: str = "") -> DeviceReport:
        """Come to rest on the path, to be resumed."""
        return self._command(self._stub.Pause, pb.PauseRequest, device)

    def resume(self, device: str = "") -> DeviceReport:
        """Go on with a paused motion."""
        return self._command(self._stub.Resume, pb.ResumeRequest, device)

    def set_speed(self, speed: float, device: str = "") -> DeviceReport:
        """Run motions at *speed*, above 0 and at most 1 as planned, now and from now on."""
        return self._command(self._stub.SetSpeed, pb.SetSpeedRequest, device, speed=speed)

    def enable(self, device: str = "") -> DeviceReport:
        """Make a device follow; it does not move by this."""
        return self._command(self._stub.Enable, pb.EnableRequest, device)

    def disable(self, device: str = "", *, by_hand: bool = False) -> DeviceReport:
        """Leave a device at rest, no longer following.

        Args:
            device: its name.
            by_hand: whether it may then be moved by hand, until it is enabled or disabled again or
                the lease runs out: an arm in freedrive, a gimbal without torque.
        """
        return self._command(self._stub.Disable, pb.DisableRequest, device, by_hand=by_hand)

    def reset(self, device: str = "") -> DeviceReport:
        """Clear a fault, which may take seconds; starts the servo anew if it has ended."""
        return self._command(self._stub.Reset, pb.ResetRequest, device)

    def _command(
        self,
        method: Callable[..., Any],
        request: Callable[..., Any],
        device: str,
        **more: Any,  # noqa: ANN401
    ) -> DeviceReport:
        def begin(token: str, number: int) -> Callable[[], Any]:
            message = request(lease_token=token, lease_sequence=number, device=device, **more)
            return self._connection.begin(method, message)

        answer = self._command_of(device, begin)()
        return device_from_message(answer.device)
