"""What a client has devices do, apart from motions: stop, pause, enable, reset and the like."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from orientd.rpc import control_pb2 as pb
from orientd.rpc.lease_holder import LeaseHolder
from orientd.rpc.reports import DeviceReport
from orientd.rpc.wire import device_from_message


class Commands(LeaseHolder):
    """A client that commands devices; all but what stops them needs their leases."""

    def stop(self, device: str = "") -> list[DeviceReport]:
        """Bring a device, or all of them, to rest on the path.  Needs no lease."""
        return self._rest(self._stub.Stop, pb.StopRequest(device=device, caller=self.holder))

    def halt(self, device: str = "") -> list[DeviceReport]:
        """Bring a device, or all of them, to rest as quickly as the limits allow.

        That may leave the path.  Needs no lease.
        """
        return self._rest(self._stub.Halt, pb.HaltRequest(device=device, caller=self.holder))

    def _rest(self, method: Callable[..., Any], request: object) -> list[DeviceReport]:
        return [device_from_message(one) for one in self._connection.ask(method, request).devices]

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

    def disable(self, device: str = "") -> DeviceReport:
        """Leave a device at rest, no longer following."""
        return self._command(self._stub.Disable, pb.DisableRequest, device)

    def reset(self, device: str = "") -> DeviceReport:
        """Clear a fault; starts the servo process anew if it has ended."""
        return self._command(self._stub.Reset, pb.ResetRequest, device)

    def _command(
        self,
        method: Callable[..., Any],
        request: Callable[..., Any],
        device: str,
        **more: Any,  # noqa: ANN401
    ) -> DeviceReport:
        wait = self._command_of(
            device,
            lambda token, number: self._connection.begin(
                method,
                request(lease_token=token, lease_sequence=number, device=device, **more),
            ),
        )
        return device_from_message(wait().device)
