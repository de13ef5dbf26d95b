"""The axes of a device as the daemon knows them: to judge targets, and to draw the device."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence

from orientd.driver import Driver, Joints, Quaternion, Vector3
from orientd.errors import LinkError, PlanError
from orientd.mechanism import Gimbal, Mechanical, Mechanism, refusal

_log = logging.getLogger(__name__)

_ASK_AGAIN = 5.0
"""s after which a device that did not say which it is is asked again."""


class DeviceAxes:
    """What is known of a device's mechanism, from any thread.

    Args:
        driver: of the device; it is not open.
        name: of the device, for the log.
    """

    def __init__(self, driver: Driver, name: str) -> None:
        self._driver = driver if isinstance(driver, Mechanical) else None
        self._name = name
        self._judging: Mechanism | None = None
        self._drawn: Mechanism | None = None
        self._asked = -_ASK_AGAIN

    def expect_targets(self) -> None:
        """Prepare for :meth:`refusal`; may ask the device.

        Raises:
            PlanError: the device does not say which it is.
        """
        self._judging = self._found(may_ask=True)

    def refusal(self, q: Quaternion, position: Vector3, joints: Joints) -> str:
        """Return why the device cannot be at a target, or an empty string.

        A gimbal follows every target as near as it can.

        Args:
            q: orientation of the target.
            position: of the target, m.
            joints: axis angles as measured, rad.
        """
        mechanism = self._judging
        if mechanism is None or isinstance(mechanism, Gimbal):
            return ""
        return refusal(mechanism, q, position, joints)

    def outline(self, joints: Joints) -> Sequence[Sequence[Vector3]]:
        """Return the device's shape as lines, m; empty until it is known which device it is."""
        if self._driver is None:
            return ()
        if self._drawn is None:
            try:
                self._drawn = self._found(may_ask=False)
            except PlanError:
                self._ask_aside()
        try:
            return () if self._drawn is None else self._drawn.outline(joints)
        except Exception:  # noqa: BLE001 - a picture is worth no trouble
            _log.exception("%s: the device cannot be drawn", self._name)
            self._driver = None
            return ()

    def _found(self, *, may_ask: bool) -> Mechanism | None:
        if self._driver is None:
            return None
        try:
            return self._driver.mechanism(may_ask=may_ask)
        except LinkError as error:
            raise PlanError(f"cannot predict the axes: {error}") from error

    def _ask_aside(self) -> None:
        """Have the device asked which it is; whoever draws does not wait for it."""
        now = time.monotonic()
        if now - self._asked < _ASK_AGAIN:
            return
        self._asked = now
        threading.Thread(target=self._ask, daemon=True).start()

    def _ask(self) -> None:
        try:
            self._drawn = self._found(may_ask=True)
        except PlanError:
            return  # asked again after a while, as long as somebody looks
