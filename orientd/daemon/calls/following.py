"""The targets and chunks of one caller that a device follows, and a report of how that goes."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator

from orientd.daemon.device import Device
from orientd.driver import Quaternion
from orientd.errors import OrientdError
from orientd.floats import difference, norm
from orientd.protocol import control_pb2 as pb
from orientd.protocol import poses_from_message, quaternion, target_from_message, vector


class Following:
    """The targets of one caller for one device."""

    def __init__(self, device: Device) -> None:
        """Begin without a target on *device*, whose servo follows from now on."""
        self._device = device
        self._given, self._left_out = device.targets.written
        self._chunks, _ = device.targets.chunks
        self._refused = self._skipped = 0
        self._refusal = ""
        self._newest: Quaternion | None = None

    def take(self, message: pb.TrackTarget) -> None:
        """Give the servo a target; count one that is not well formed."""
        try:
            target = target_from_message(message, time.monotonic_ns())
            self._device.targets.aim(*target)
        except OrientdError as error:
            self.refuse(str(error))
        else:
            self._newest = target.q

    def take_chunk(self, message: pb.TrackChunk) -> None:
        """Give the servo a chunk; count one that is not well formed, and poses that are none."""
        try:
            samples, skipped = poses_from_message(message, time.monotonic_ns())
            left_out, problem = self._device.targets.play(samples)
        except OrientdError as error:
            self.refuse(str(error))
            return
        self._skipped += skipped + left_out
        self._refusal = problem or self._refusal

    def refuse(self, problem: str) -> None:
        """Count a message that has no target."""
        self._refused += 1
        self._refusal = problem

    def report(self) -> pb.TrackResponse | None:
        """Return how it goes; ``None`` while there is no servo."""
        now = self._device.snapshot()
        cycle = now.cycle
        if cycle is None:
            return None
        given, left_out = self._device.targets.written
        chunks, found = self._device.targets.chunks
        chunks -= self._chunks
        return pb.TrackResponse(
            chunks=pb.ChunkReport(
                chunks=chunks,
                live=found.live,
                stale=found.stale,
                skipped=self._skipped,
                starved=found.starved,
                largest_seam=found.seam,
                behind=found.behind,
                largest_behind=found.farthest,
                least_left=found.least_left,
                lag=found.lag,
            )
            if chunks
            else None,
            state=f"STATE_{cycle.state.name}",
            q=quaternion(cycle.q),
            position=vector(cycle.position),
            omega_body=vector(cycle.omega_body),
            time_ns=cycle.deadline_ns,
            targets=given - self._given,
            left_out=left_out - self._left_out,
            refused=self._refused,
            refusal=self._refusal,
            error=None if self._newest is None else norm(difference(cycle.q, self._newest)),
            held_at=now.held_at,
        )


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
