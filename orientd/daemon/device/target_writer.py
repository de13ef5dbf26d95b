"""Hand targets and chunks of poses to a servo that follows them."""

from __future__ import annotations

from collections.abc import Sequence

from orientd.daemon.device.axes import DeviceAxes
from orientd.daemon.device.servo_process import ServoProcess
from orientd.driver import Quaternion, Vector3
from orientd.errors import RequestError
from orientd.servo import LEFT_OUT_WORD, ChunkReport, publish_chunk, read_report
from orientd.stream import NOT_GIVEN, Cycle, Sample


class TargetWriter:
    """Writes to the rings of targets and of chunks.  To be called by one thread at a time."""

    def __init__(self, servo: ServoProcess, axes: DeviceAxes) -> None:
        """Write to *servo* what *axes* can reach."""
        self._servo, self._axes = servo, axes

    def aim(
        self,
        q: Quaternion,
        omega_body: Vector3 | None,
        time_ns: int,
        expires_ns: int,
        position: Vector3 | None = None,
    ) -> None:
        """Hand the servo a target; waits for nothing.

        Raises:
            RequestError: the device cannot be there.
            StateError: there is no servo.
        """
        memory = self._servo.running()
        problem = self._refusal(q, position, self._servo.newest())
        if problem:
            raise RequestError("target", problem)
        memory.targets.publish(
            time_ns, expires_ns, *q, *(omega_body or NOT_GIVEN), *(position or NOT_GIVEN)
        )

    def play(self, samples: Sequence[Sample]) -> tuple[int, str]:
        """Hand the servo a chunk of poses; waits for nothing.

        Args:
            samples: times ascending.

        Returns:
            How many poses were left out since the device cannot be there, and why the first was.

        Raises:
            RequestError: the device cannot be at any of the poses.
            StateError: there is no servo.
        """
        memory = self._servo.running()
        cycle = self._servo.newest()
        problems = [self._refusal(sample.q, sample.position, cycle) for sample in samples]
        kept = [one for one, problem in zip(samples, problems, strict=True) if not problem]
        problem = next(filter(None, problems), "")
        if not kept:
            raise RequestError("chunk", problem)
        publish_chunk(memory.chunks, kept)
        return len(samples) - len(kept), problem

    def _refusal(self, q: Quaternion, position: Vector3 | None, cycle: Cycle | None) -> str:
        """Return why the device, as of *cycle*, cannot be at a pose, or an empty string."""
        if cycle is None or not cycle.joints:
            return ""
        at = cycle.position if position is None else position
        return self._axes.refusal(q, at, cycle.joints)

    @property
    def written(self) -> tuple[int, int]:
        """How many targets the servo process was given so far, and how many it left out."""
        ring = self._servo.running().targets
        return ring.head, ring.words[LEFT_OUT_WORD]

    @property
    def chunks(self) -> tuple[int, ChunkReport]:
        """How many chunks the servo process was given so far, and how it followed them."""
        ring = self._servo.running().chunks
        return ring.head, read_report(ring)
