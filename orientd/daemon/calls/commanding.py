"""Commands to devices: stop, pause, enable, reset and the like."""

from __future__ import annotations

from collections.abc import Callable

from orientd.daemon.access import Caller
from orientd.daemon.calls.calls import Calls
from orientd.daemon.calls.report import device_report
from orientd.daemon.device import Device
from orientd.errors import RequestError, StateError
from orientd.rpc import control_pb2 as pb
from orientd.stream import ServoState

_CommandRequest = (
    pb.PauseRequest
    | pb.ResumeRequest
    | pb.SetSpeedRequest
    | pb.EnableRequest
    | pb.DisableRequest
    | pb.ResetRequest
)
"""What every command to a device says: which, and under which lease."""


class CommandingCalls(Calls):
    """Calls that command a device; all but those that stop it need the lease."""

    async def Stop(self, request: pb.StopRequest, caller: Caller) -> pb.StopResponse:
        """Stop devices on their paths."""

        def work() -> pb.StopResponse:
            devices = self._cell.stop(
                request.device, str(caller.identity), motion=request.motion_number
            )
            return pb.StopResponse(devices=[device_report(device) for device in devices])

        return await self._cell.in_worker(work)

    async def Halt(self, request: pb.HaltRequest, caller: Caller) -> pb.HaltResponse:
        """Stop devices as quickly as the limits allow."""

        def work() -> pb.HaltResponse:
            devices = self._cell.stop(request.device, str(caller.identity), is_quickest=True)
            return pb.HaltResponse(devices=[device_report(device) for device in devices])

        return await self._cell.in_worker(work)

    async def Pause(self, request: pb.PauseRequest, caller: Caller) -> pb.PauseResponse:
        """Pause a motion."""
        device = await self._command(
            request, "pause", lambda device: moving(device, "pause").pause()
        )
        return pb.PauseResponse(device=device)

    async def Resume(self, request: pb.ResumeRequest, caller: Caller) -> pb.ResumeResponse:
        """Go on with a paused motion."""
        device = await self._command(
            request, "resume", lambda device: moving(device, "resume").resume()
        )
        return pb.ResumeResponse(device=device)

    async def SetSpeed(self, request: pb.SetSpeedRequest, caller: Caller) -> pb.SetSpeedResponse:
        """Set the rate at which motions run."""
        speed = request.speed
        if not 0.0 < speed <= 1.0:
            problem = f"expected more than 0 and at most 1, got {speed:g}"
            raise RequestError("speed", problem)
        device = await self._command(
            request, f"speed {speed:g}", lambda device: device.set_speed(speed)
        )
        return pb.SetSpeedResponse(device=device)

    async def Enable(self, request: pb.EnableRequest, caller: Caller) -> pb.EnableResponse:
        """Make a device follow."""
        device = await self._command(request, "enable", lambda device: device.enable())
        return pb.EnableResponse(device=device)

    async def Disable(self, request: pb.DisableRequest, caller: Caller) -> pb.DisableResponse:
        """Leave a device at rest, no longer following."""
        is_freed = request.by_hand
        what = "disable, to be moved by hand" if is_freed else "disable"
        device = await self._command(
            request, what, lambda device: device.disable(is_freed=is_freed)
        )
        return pb.DisableResponse(device=device)

    async def Reset(self, request: pb.ResetRequest, caller: Caller) -> pb.ResetResponse:
        """Clear a fault."""
        device = await self._command(request, "reset", lambda device: device.reset())
        return pb.ResetResponse(device=device)

    async def _command(
        self, request: _CommandRequest, what: str, act: Callable[[Device], None]
    ) -> pb.DeviceReport:
        def work() -> pb.DeviceReport:
            device = self._cell.command(
                request.lease_token, request.lease_sequence, request.device, what, act
            )
            return device_report(device)

        turn = await self._in_turn(request.lease_token, request.device, request.lease_sequence)
        # The next one's turn comes with this one's check; it is done, and told, after this one.
        async with turn:
            return await self._cell.in_worker(work)


def moving(device: Device, what: str) -> Device:
    """Return *device*, which is on a motion to do *what* to.

    Raises:
        StateError: it is on none.
    """
    state = device.snapshot().state
    if state is not ServoState.STREAMING:
        raise StateError(f"device {device.name} is {state.name.lower()}: no motion to {what}")
    return device
