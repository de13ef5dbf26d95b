"""The targets of one caller that a device follows, and a report of how that goes."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator

from orientd.daemon.device import Device
from orientd.driver import Quaternion
from orientd.errors import OrientdError
from orientd.floats import difference, norm
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion, target_from_message, vector


class Following:
    """The targets of one caller for one device."""

    def __init__(self, device: Device) -> None:
        """Begin without a target on *device*, whose servo follows from now on."""
        self._device = device
        self._given, self._left_out = device.targets
        self._refused = 0
        self._refusal = ""
        self._newest: Quaternion | None = None

    def take(self, message: pb.TrackTarget) -> None:
        """Give the servo a target; count one that is not well formed."""
        try:
            target = target_from_message(message, time.monotonic_ns())
            self._device.aim(*target)
        except OrientdError as error:
            self.refuse(str(error))
        else:
            self._newest = target.q

    def refuse(self, problem: str) -> None:
        """Count a message that has no target."""
        self._refused += 1
        self._refusal = problem

    def report(self) -> pb.TrackResponse | None:
        """Return how it goes; ``None`` while there is no servo."""
        cycle = self._device.snapshot().cycle
        if cycle is None:
            return None
        given, left_out = self._device.targets
        return pb.TrackResponse(
            state=f"STATE_{cycle.state.name}",
            q=quaternion(cycle.q),
            omega_body=vector(cycle.omega_body),
            time_ns=cycle.deadline_ns,
            targets=given - self._given,
            left_out=left_out - self._left_out,
            refused=self._refused,
            refusal=self._refusal,
            error=None if self._newest is None else norm(difference(cycle.q, self._newest)),
        )


async def read_targets(requests: AsyncIterator[pb.TrackRequest], following: Following) -> None:
    """Take the targets of *requests* until there are no more."""
    async for request in requests:
        if request.WhichOneof("what") == "target":
            following.take(request.target)
        else:
            following.refuse("target: expected in every message after the first")
