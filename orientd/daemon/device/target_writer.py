"""Hand targets and chunks of poses that the axes can reach to a servo that follows them."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Sequence
from math import inf

from orientd.daemon.device.servo_process import ServoProcess
from orientd.driver import Driver, Joints, Quaternion, Vector3
from orientd.errors import LinkError, PlanError, RequestError
from orientd.mechanism import Gimbal, Mechanical, Mechanism
from orientd.mechanism.mechanism import refusal
from orientd.servo.tracking.chunk_report import ChunkReport, read_report
from orientd.servo.tracking.chunks import Smoothed, publish_chunk
from orientd.stream import Cycle
from orientd.stream.records import (
    DEVIATION_WORD,
    LARGEST_DEVIATION_WORD,
    LEFT_OUT_WORD,
    NOT_GIVEN,
    Sample,
    ServoLimits,
)

_log = logging.getLogger(__name__)

_ASK_AGAIN = 5.0
"""s after which a device that did not say which it is is asked again."""


_UNLIMITED = ServoLimits(inf, inf, inf, inf, inf, inf)
"""Until the device follows anything."""


class DeviceAxes:
    """Provide a device's mechanism as far as it is known, from any thread.

    Args:
        driver: of the device; it is not open.
        name: of the device, for the log.
    """

    def __init__(self, driver: Driver, name: str) -> None:
        self._driver = driver if isinstance(driver, Mechanical) else None
        self._name = name
        self._mechanism: Mechanism | None = None
        self._asked = -_ASK_AGAIN

    def expect_targets(self) -> None:
        """Prepare for :meth:`refusal`; may ask the device.

        Raises:
            PlanError: the device does not say which it is.
        """
        self._find(may_ask=True)

    def refusal(self, q: Quaternion, position: Vector3, joints: Joints) -> str:
        """Return why the device cannot be at a target, or an empty string.

        A gimbal follows every target as near as it can.

        Args:
            q: orientation of the target.
            position: of the target, m.
            joints: axis angles as measured, rad.
        """
        mechanism = self._mechanism
        if mechanism is None or isinstance(mechanism, Gimbal):
            return ""
        return refusal(mechanism, q, position, joints)

    def outline(self, joints: Joints) -> Sequence[Sequence[Vector3]]:
        """Return the device's shape as lines, m; empty until it is known which device it is."""
        try:
            if self._mechanism is None:
                self._find(may_ask=False)
            return () if self._mechanism is None else self._mechanism.outline(joints)
        except PlanError:
            # Drawing does not wait for the device.
            now = time.monotonic()
            if now - self._asked >= _ASK_AGAIN:
                self._asked = now
                threading.Thread(target=self._ask, daemon=True).start()
        except Exception:  # noqa: BLE001 - a picture is worth no trouble
            _log.exception("%s: the device cannot be drawn", self._name)
            self._driver = self._mechanism = None
        return ()

    def _ask(self) -> None:
        with contextlib.suppress(PlanError):  # the next drawing asks again
            self._find(may_ask=True)

    def _find(self, *, may_ask: bool) -> None:
        if self._driver is not None:
            try:
                self._mechanism = self._driver.mechanism(may_ask=may_ask)
            except LinkError as error:
                raise PlanError(f"cannot predict the axes: {error}") from error


class TargetWriter:
    """Writes to the rings of targets and of chunks.  To be called by one thread at a time."""

    def __init__(self, servo: ServoProcess, axes: DeviceAxes) -> None:
        """Write to *servo* what *axes* can reach."""
        self._servo, self._axes = servo, axes
        self._limits = _UNLIMITED

    def begin(self, limits: ServoLimits) -> None:
        """Prepare for a following within limits.

        Raises:
            PlanError: the device does not report the data needed to check targets.
        """
        self._axes.expect_targets()
        self._limits = limits

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

    def play(self, samples: Sequence[Sample], observed_ns: int) -> tuple[int, str, Smoothed]:
        """Hand the servo a chunk of poses; waits for nothing.

        Args:
            samples: times ascending.
            observed_ns: the observation that it answers; 0 if it names none.

        Returns:
            How many poses were left out since the device cannot be there, why the first was, and
            the curve that is played.

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
        curve = publish_chunk(memory.chunks, kept, self._limits, observed_ns)
        return len(samples) - len(kept), problem, curve

    def _refusal(self, q: Quaternion, position: Vector3 | None, cycle: Cycle | None) -> str:
        """Return why the device, as of *cycle*, cannot be at a pose, or an empty string."""
        if cycle is None or not cycle.joints:
            return ""
        at = cycle.position if position is None else position
        return self._axes.refusal(q, at, cycle.joints)

    def count(self) -> TargetCounts:
        """Count the targets and chunks of the servo process from now on, beginning at zero.

        Raises:
            DaemonError: there is no servo.
        """
        return TargetCounts(self._servo)


class TargetCounts:
    """Counts of targets and chunks for one servo process, from a moment on.

    A servo that is started again counts from zero.  So these counts are of the process that ran
    when they began, also after its end.
    """

    def __init__(self, servo: ServoProcess) -> None:
        """Begin at zero.

        Raises:
            DaemonError: there is no servo.
        """
        self._servo, self._memory = servo, servo.running()
        targets = self._memory.targets
        self._given, self._left_out = targets.head, targets.words[LEFT_OUT_WORD]
        self._chunks = self._memory.chunks.head

    @property
    def is_of_newest_servo(self) -> bool:
        """Whether no other servo process has started since these counts began."""
        return self._servo.memory is self._memory

    @property
    def targets(self) -> tuple[int, int]:
        """How many targets the servo process was given, and how many it left out."""
        ring = self._memory.targets
        return ring.head - self._given, ring.words[LEFT_OUT_WORD] - self._left_out

    @property
    def path_deviations(self) -> tuple[float, float]:
        """Distance of an arm's tool from its straight line, and the largest so far, m."""
        words = self._memory.targets.words
        return 1e-9 * words[DEVIATION_WORD], 1e-9 * words[LARGEST_DEVIATION_WORD]

    @property
    def chunks(self) -> tuple[int, ChunkReport]:
        """How many chunks the servo process was given, and how it followed them."""
        ring = self._memory.chunks
        return ring.head - self._chunks, read_report(ring)
