"""Latency identification: move a device a little to find how far it is behind its setpoints."""

from __future__ import annotations

import asyncio
import time

from orientd import rotation
from orientd.config import DeviceSettings
from orientd.daemon.calls.latency import Latency, identify
from orientd.daemon.cell import planner_device
from orientd.daemon.device import Device
from orientd.daemon.planners import PlanCall, Planners
from orientd.errors import DaemonError, OrientdError
from orientd.planner import Keyframe, MotionRequest
from orientd.rpc import from_request
from orientd.stream import Cycle, CycleFlag, ServoState

ANGLE = 0.2
"""How far the tool turns about its own z axis and back, rad."""

SECONDS = 3.0
"""How long that takes, without coming to rest in between."""

_READY = 20.0
_SETTLING = 0.5
_POLL = 0.005


def measure_latency(settings: DeviceSettings) -> Latency:
    """Start the device of *settings*, turn its tool by :data:`ANGLE` and back, and let go of it.

    Raises:
        ConfigError: the driver is not installed, or refuses its options.
        DaemonError: the device cannot be started, or did not follow to the end.
        PlanError: the motion is not inside the device's limits.
    """
    cycles = asyncio.run(_measure(settings))
    written = [cycle for cycle in cycles if cycle.flags & CycleFlag.WRITTEN]
    measured = {
        cycle.feedback_time_ns: cycle.feedback_q
        for cycle in cycles
        if cycle.flags & CycleFlag.FEEDBACK
    }
    try:
        return identify(
            [(cycle.deadline_ns * 1e-9, cycle.q) for cycle in written],
            [(time_ns * 1e-9, q) for time_ns, q in measured.items()],
        )
    except ValueError as error:
        raise DaemonError(f"the latency cannot be told: {error}") from error


async def _measure(settings: DeviceSettings) -> list[Cycle]:
    planners = Planners([planner_device(settings)], processes=1, timeout=_READY)
    device = Device(settings, planners=planners, on_event=lambda _event: None)
    planners.start()
    device.launch()
    try:
        if not device.wait_ready(_READY):
            raise DaemonError(device.failure or f"not ready within {_READY:g} s")
        if device.snapshot().state is ServoState.IDLE:
            device.enable()
        await _holding(device, _READY)
        return await _move(device)
    finally:
        device.shutdown()
        await planners.close()


async def _move(device: Device) -> list[Cycle]:
    start = device.commanded()
    angles = ((0.0, 0.0), (0.5 * SECONDS, ANGLE), (SECONDS, 0.0))
    keyframes = []
    for seconds, angle in angles:
        w, x, y, z = rotation.multiply(start.q, rotation.exp([0.0, 0.0, angle])).tolist()
        keyframes.append(Keyframe((w, x, y, z), seconds))
    request = MotionRequest(keyframes=keyframes)
    order = PlanCall(from_request(request).SerializeToString(), timeout=_READY)
    prepared = await device.prepare(order)
    before = device.snapshot().cycle
    device.start(prepared)
    await _holding(device, prepared.motion.facts.duration + _READY)
    await asyncio.sleep(_SETTLING)
    return device.cycles(before.index if before else 0)


async def _holding(device: Device, seconds: float) -> None:
    """Wait until the device holds; the event loop, which feeds it, goes on meanwhile."""
    ends = time.monotonic() + seconds
    while (now := device.snapshot()).state is not ServoState.HOLDING:
        if now.state is ServoState.FAULT:
            raise OrientdError(f"device {device.name} is in a fault: {now.fault_text}")
        if time.monotonic() > ends:
            raise DaemonError(f"device {device.name} does not come to hold within {seconds:g} s")
        await asyncio.sleep(_POLL)
