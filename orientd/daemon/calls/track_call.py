"""One Track call: the caller's targets on their way to the servo, and what there is to report."""

from __future__ import annotations

import time

from orientd.daemon.device import Device
from orientd.driver import Quaternion
from orientd.errors import OrientdError
from orientd.floats import difference, norm
from orientd.rpc import TrackReport, target_from_message
from orientd.rpc import control_pb2 as pb


class TrackCall:
    """The targets of one caller for one device."""

    def __init__(self, device: Device) -> None:
        """Begin with nothing to follow on *device*, whose servo does."""
        self._device = device
        self._given, self._left_out = device.targets
        self._refused = 0
        self._refusal = ""
        self._newest: Quaternion | None = None

    def take(self, message: pb.TrackTarget) -> None:
        """Hand a target on; one that is none is counted and left out."""
        try:
            target = target_from_message(message, time.monotonic_ns())
            self._device.aim(*target)
        except OrientdError as error:
            self.refuse(str(error))
        else:
            self._newest = target.q

    def refuse(self, problem: str) -> None:
        """Count something that is not even a target."""
        self._refused += 1
        self._refusal = problem

    def report(self) -> TrackReport | None:
        """Return how it goes; ``None`` while there is no servo to tell."""
        cycle = self._device.snapshot().cycle
        if cycle is None:
            return None
        given, left_out = self._device.targets
        return TrackReport(
            state=cycle.state,
            q=cycle.q,
            omega_body=cycle.omega_body,
            time_ns=cycle.deadline_ns,
            targets=given - self._given,
            left_out=left_out - self._left_out,
            refused=self._refused,
            refusal=self._refusal,
            error=None if self._newest is None else norm(difference(cycle.q, self._newest)),
        )
