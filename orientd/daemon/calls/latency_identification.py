"""Latency identification: move a device a little to find how far it is behind its setpoints.

Not for the servo process: what was sent and what was measured is looked at for a whole motion.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from orientd import rotation
from orientd.config import DeviceSettings
from orientd.daemon.device import Device
from orientd.daemon.planners.messages import PlanRequest
from orientd.daemon.planners.pool import Planners
from orientd.driver import Quaternion
from orientd.errors import DaemonError, OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.rotation import Floats
from orientd.stream.records import Cycle, CycleFlag, ServoState

ANGLE = 0.2
"""How far the tool turns about its own z axis and back, rad."""

SECONDS = 3.0
"""How long that takes, without coming to rest in between."""

_READY = 20.0
_SETTLING = 0.5
_POLL = 0.005
_LEAST_TURN = 0.01
_LONGEST, _STEP = 0.4, 0.002
"""Largest delay looked for, and distance of the delays tried, s."""


@dataclass(frozen=True, slots=True)
class Latency:
    """The delay that explains the measurements best.

    Attributes:
        seconds: the delay.
        error: root mean square angle between measurements and setpoints of the same time, rad.
        error_led: root mean square angle to the setpoints sent that much earlier, rad.
    """

    seconds: float
    error: float
    error_led: float


def measure_latency(settings: DeviceSettings) -> Latency:
    """Start the device of *settings*, turn its tool by :data:`ANGLE` and back, and let go of it.

    Raises:
        ConfigError: the driver is not installed, or refuses its options.
        DaemonError: the device cannot be started, or did not follow to the end.
        PlanError: the motion is not within the device's limits.
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
        raise DaemonError(f"cannot identify the latency: {error}") from error


async def _measure(settings: DeviceSettings) -> list[Cycle]:
    planners = Planners([settings], processes=1, timeout=_READY)
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
        q = rotation.multiply(start.q, rotation.exp([0.0, 0.0, angle])).tolist()
        keyframes.append({"time": seconds, "quaternion": dict(zip("wxyz", q, strict=True))})
    text = json.dumps({"keyframes": keyframes})
    asked = PlanRequest(text.encode(), timeout=_READY)
    before = device.snapshot().cycle
    with device.expecting() as run:
        await device.move(run, asked)
    # The newest cycle may be from before the motion: its end counts, and not the state.
    ended, longest = asyncio.wrap_future(run.ended), run.motion.facts.duration + _READY
    try:
        outcome, text = await asyncio.wait_for(ended, longest)
    except TimeoutError:
        raise DaemonError(f"device {device.name} still moves after {longest:g} s") from None
    if outcome != pb.OUTCOME_DONE:
        raise DaemonError(f"device {device.name} did not follow to the end: {text}")
    await asyncio.sleep(_SETTLING)
    return device.cycles(before.index if before else 0)


async def _holding(device: Device, seconds: float) -> None:
    """Wait until the device holds; meanwhile the event loop continues to feed it."""
    ends = time.monotonic() + seconds
    while (now := device.snapshot()).state is not ServoState.HOLDING:
        if now.state is ServoState.FAULT:
            raise OrientdError(f"device {device.name} is in a fault: {now.fault_text}")
        if time.monotonic() > ends:
            raise DaemonError(f"device {device.name} is not holding after {seconds:g} s")
        await asyncio.sleep(_POLL)


def identify(
    sent: Sequence[tuple[float, Quaternion]], measured: Sequence[tuple[float, Quaternion]]
) -> Latency:
    """Return the delay at which *measured* correlates best with *sent*.

    The cross-correlation is largest at the delay with the smallest mean square difference.  A
    parabola through the three smallest values finds the delay between two steps.

    Args:
        sent: time (s) and orientation of each setpoint, in order.
        measured: the same of the measurements, on the same clock.

    Raises:
        ValueError: there are too few measurements, or the motion turned by too little.
    """
    if len(sent) < 3 or len(measured) < 3:
        raise ValueError(
            f"expected at least 3 setpoints and 3 measurements, got {len(sent)} and {len(measured)}"
        )
    origin = rotation.conjugate(sent[0][1])
    times, path = _turned(origin, sent)
    turned = float(np.linalg.norm(path, axis=1).max())
    if turned < _LEAST_TURN:
        raise ValueError(f"the motion must turn by {_LEAST_TURN} rad or more, got {turned:.3g}")
    instants, points = _turned(origin, [one for one in measured if times[0] <= one[0] <= times[-1]])
    if len(points) < 3:
        raise ValueError("fewer than 3 measurements fall into the time of the setpoints")

    def mean_square(delay: float) -> float:
        expected = [np.interp(instants - delay, times, component) for component in path.T]
        return float(((points.T - expected) ** 2).sum(axis=0).mean())

    count = round(_LONGEST / _STEP)
    squares = [mean_square(k * _STEP) for k in range(count + 1)]
    best = min(range(count + 1), key=squares.__getitem__)
    seconds = best * _STEP
    if 0 < best < count:
        before, here, after = squares[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        seconds += 0.5 * _STEP * (before - after) / bend if bend > 0.0 else 0.0
    led = mean_square(seconds)
    return Latency(seconds, sqrt(squares[0]), sqrt(led))


def _turned(
    origin: Floats, orientations: Sequence[tuple[float, Quaternion]]
) -> tuple[Floats, Floats]:
    """Return times, and the rotation vectors ``(n, 3)`` from the conjugate of *origin* to then."""
    times = np.array([time for time, _ in orientations])
    q = np.array([q for _, q in orientations]).reshape(-1, 4)
    return times, rotation.log(rotation.multiply(origin, q))
