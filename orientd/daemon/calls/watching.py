"""What there is: the daemon, its devices, their cycles, and what happens to them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterable

from orientd.daemon.access import Caller
from orientd.daemon.calls import report
from orientd.daemon.calls.calls import Calls, interval
from orientd.daemon.device import Device
from orientd.daemon.supervised_device import TICK
from orientd.rpc import control_pb2 as pb
from orientd.stream import CYCLE_RECORD, record_index

_HEARINGS = 10
"""How often the reason of a fault is asked for that the device's thread has not heard yet."""

_BATCH = 256
"""Cycles made into messages at a time: others get their turn before a watcher that is behind."""


class WatchingCalls(Calls):
    """Calls that look on, and command nothing."""

    async def GetState(self, request: pb.GetStateRequest, caller: Caller) -> pb.GetStateResponse:
        """Report on the daemon and its devices."""
        if request.device:
            return await self._state_of([self._cell.device(request.device)])
        return await self.present_state()

    async def present_state(self) -> pb.GetStateResponse:
        """Return the daemon and all of its devices as they are now."""
        return await self._state_of(self._cell.devices.values())

    async def _state_of(self, devices: Iterable[Device]) -> pb.GetStateResponse:
        return pb.GetStateResponse(
            daemon=self._describe(),
            devices=[await _with_reason(device) for device in devices],
        )

    async def WatchState(
        self, request: pb.WatchStateRequest, caller: Caller
    ) -> AsyncIterator[pb.WatchStateResponse]:
        """Report cycles until the caller goes."""
        device = self._cell.device(request.device)
        pause = interval("rate_hz", request.rate_hz)
        reader = report.CycleReader(device)
        step = max(1, request.decimation)
        wait = pause
        while not await self._is_closing_within(wait):
            wait = pause
            response = pb.WatchStateResponse()
            records, response.lost = reader.read_records(None if request.as_records else _BATCH)
            if request.as_records:
                response.records, response.layout = b"".join(records), CYCLE_RECORD.format
            else:
                wait = 0.0 if len(records) == _BATCH else pause
                response.cycles.extend(
                    report.record_message(record)
                    for record in records
                    if record_index(record) % step == 0
                )
            if not (response.records or response.cycles or response.lost):
                continue
            if request.with_outline:
                response.outline.extend(
                    pb.Polyline(coordinates=[x for point in line for x in point])
                    for line in device.outline()
                )
            yield response

    async def WatchEvents(
        self, request: pb.WatchEventsRequest, caller: Caller
    ) -> AsyncIterator[pb.WatchEventsResponse]:
        """Report events until the caller goes."""
        device = self._cell.device(request.device).name if request.device else ""
        loop, wake = asyncio.get_running_loop(), asyncio.Event()
        subscription = self._cell.journal.subscribe(
            device, lambda: loop.call_soon_threadsafe(wake.set)
        )
        try:
            yield pb.WatchEventsResponse()
            while await self._is_woken(wake):
                yield subscription.take()
        finally:
            subscription.close()

    async def GetConfiguration(
        self, request: pb.GetConfigurationRequest, caller: Caller
    ) -> pb.GetConfigurationResponse:
        """Report the settings."""
        answer = pb.GetConfigurationResponse(json=self._cell.configuration)
        answer.monotonic_ns = time.monotonic_ns()
        answer.time.FromNanoseconds(time.time_ns())
        return answer

    async def ListMethods(self, request: pb.ListMethodsRequest, caller: Caller) -> bytes:
        """List the families of curves."""
        return await self._cell.planners.methods(caller.key)

    async def ListDevices(
        self, request: pb.ListDevicesRequest, caller: Caller
    ) -> pb.ListDevicesResponse:
        """List the devices."""
        devices = self._cell.devices.values()
        return pb.ListDevicesResponse(devices=map(report.device_description, devices))


async def _with_reason(device: Device) -> pb.DeviceReport:
    """Return what there is to say about a device, of a fault with its reason.

    The device's thread hears the reason only when it is done with what it was about, which takes
    its time after the daemon itself stood still.
    """
    said = report.device_report(device)
    for _ in range(_HEARINGS):
        if said.state != pb.STATE_FAULT or said.fault_text:
            break
        await asyncio.sleep(TICK)
        said = report.device_report(device)
    return said
