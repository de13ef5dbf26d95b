"""The targets and chunks of one caller that a device follows, and a report of how that goes.

The daemon counts each target, chunk and pose that it refuses, and reports why the last one was.
The first one is also an event of the device.  An event reports later ones together, once in
:data:`SPACING` seconds, so that a stream of them does not flood the log.
"""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from math import dist

from orientd.daemon.device import Device, EventKind
from orientd.driver import Quaternion, Vector3
from orientd.errors import OrientdError
from orientd.floats import difference, norm
from orientd.protocol import control_pb2 as pb
from orientd.protocol.targets import AimedAt, poses_from_message, target_from_message
from orientd.protocol.values import quaternion, vector

SPACING = 10.0
"""Least time between two events about the messages of one caller, s."""


class Following:
    """The targets of one caller for one device."""

    def __init__(self, device: Device) -> None:
        """Begin without a target on *device*, whose servo follows from now on.

        Raises:
            DaemonError: the servo has ended.
        """
        self._device, self._counts = device, device.targets.count()
        self._refused = self._skipped = self._smoothed = 0
        self._turn = self._shift = 0.0
        self._refusal = ""
        self._newest: AimedAt | None = None
        self._untold, self._told = 0, -SPACING

    def take(self, message: pb.TrackTarget) -> None:
        """Give the servo a target; count one that is not well formed."""
        try:
            target = target_from_message(message, time.monotonic_ns())
            self._device.targets.aim(*target)
        except OrientdError as error:
            self.refuse(str(error))
        else:
            self._newest = target

    def take_chunk(self, message: pb.TrackChunk) -> None:
        """Give the servo a chunk; count one that is not well formed, and poses that are none."""
        now_ns = time.monotonic_ns()
        try:
            samples, skipped, malformed = poses_from_message(message, now_ns)
            left_out, out_of_reach, curve = self._device.targets.play(samples, message.observed_ns)
        except OrientdError as error:
            self.refuse(str(error))
            return
        self._skipped += skipped + left_out
        self._smoothed += max(curve.turn, curve.shift) > 0.0
        self._turn, self._shift = max(self._turn, curve.turn), max(self._shift, curve.shift)
        late = 1e-9 * (now_ns - samples[-1].time_ns)
        if late >= 0.0:
            self._tell(
                f"chunk: its last pose was due {late:.3g} s before it arrived, so none is played; "
                "send longer chunks, or stamp them later"
            )
        elif malformed or out_of_reach:
            self._tell(f"{malformed or out_of_reach}; skipped")

    def refuse(self, problem: str) -> None:
        """Count a message that has no target."""
        self._refused += 1
        self._tell(problem)

    def _tell(self, problem: str) -> None:
        """Report a problem of a message, also as an event if one is due."""
        self._refusal = problem
        self._untold += 1
        now = time.monotonic()
        if now - self._told < SPACING:
            return
        before = self._untold - 1
        more = f" (and {before} other problems since the last event)" if before else ""
        self._untold, self._told = 0, now
        self._device.tell(EventKind.WARNING, f"a client's targets: {problem}{more}")

    def report(self) -> pb.TrackResponse | None:
        """Return how it goes; ``None`` once the servo process that follows has ended."""
        now = self._device.snapshot()
        cycle = now.cycle
        # Another process may have started since.  Its cycles are not of these targets.
        if cycle is None or not self._counts.is_of_newest_servo:
            return None
        given, left_out = self._counts.targets
        chunks, found = self._counts.chunks
        error, position_error = self._errors(cycle.q, cycle.position)
        deviation, largest_deviation = self._counts.path_deviations
        return pb.TrackResponse(
            chunks=pb.ChunkReport(
                chunks=chunks,
                skipped=self._skipped,
                smoothed=self._smoothed,
                largest_smoothing=self._turn,
                largest_position_smoothing=self._shift,
                **found._asdict(),
            )
            if chunks
            else None,
            state=f"STATE_{cycle.state.name}",
            q=quaternion(cycle.q),
            position=vector(cycle.position),
            omega_body=vector(cycle.omega_body),
            time_ns=cycle.deadline_ns,
            targets=given,
            left_out=left_out,
            refused=self._refused,
            refusal=self._refusal,
            error=error,
            position_error=position_error,
            held_at=now.held_at,
            path_deviation=deviation,
            largest_path_deviation=largest_deviation,
        )

    def _errors(self, q: Quaternion, position: Vector3) -> tuple[float | None, float | None]:
        """Return how far a setpoint is from the newest target, rad and m, as far as that says."""
        newest = self._newest
        if newest is None:
            return None, None
        away = None if newest.position is None else dist(position, newest.position)
        return norm(difference(q, newest.q)), away


async def read_targets(requests: AsyncIterator[pb.TrackRequest], following: Following) -> None:
    """Take the targets of *requests* until there are no more."""
    async for request in requests:
        match request.WhichOneof("what"):
            case "target":
                following.take(request.target)
            case "chunk":
                following.take_chunk(request.chunk)
            case _:
                following.refuse("target: expected one, or a chunk, after the first message")
