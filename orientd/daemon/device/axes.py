"""The axes of a device as the daemon knows them: to judge targets, and to draw the device."""

from __future__ import annotations

import contextlib
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
