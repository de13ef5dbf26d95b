"""The messages that a MAVLink gimbal sends about itself, on request and at intervals."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

import orientd
from orientd.floats import multiply
from orientd.protocol.values import to_quaternion, to_vector
from orientd_mavlink.gimbal import Gimbal
from orientd_mavlink.setpoint import (
    ACCEPTS_YAW_IN_EARTH_FRAME,
    YAW_IN_VEHICLE_FRAME,
    mirrored,
    of_angles,
)
from orientd_serving.served import Served

GIMBAL_ID = 1
"""Gimbal device id: manager and device are one component."""

_STALE = 0.5
"""Age from which a measurement counts as a failure of the device, s."""

_USUAL_INTERVALS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: 0.2,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 0.1,
}
"""Seconds between two messages of a kind."""

_LEAST_INTERVAL = 0.02


class Reports:
    """The reports of the gimbal.

    Attributes:
        holders: primary and secondary system and component in control, 0 for none.
    """

    def __init__(self, served: Served, gimbal: Gimbal, driver: str) -> None:
        """Report on a gimbal.

        Args:
            served: the device.
            gimbal: the gimbal that it is.
            driver: name of the device's driver.
        """
        self._served, self._gimbal, self._driver = served, gimbal, driver
        self.holders: Sequence[tuple[int, int]] = ((0, 0), (0, 0))
        self._began = time.monotonic()
        self._intervals = dict(_USUAL_INTERVALS)
        self._due = dict.fromkeys(_USUAL_INTERVALS, 0.0)
        self._makers: dict[int, Callable[[], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self._status,
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._attitude,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: self._manager,
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_INFORMATION: self._device,
        }

    @property
    def offered(self) -> str:
        """The messages that can be asked for, in words."""
        return f"this gimbal has the messages {', '.join(map(str, sorted(self._makers)))}"

    @property
    def regular(self) -> str:
        """The messages that are sent regularly, in words."""
        numbers = ", ".join(map(str, sorted(self._intervals)))
        return f"this gimbal has the messages {numbers} at intervals"

    def message(self, number: float) -> Any:  # noqa: ANN401 - pymavlink has no types
        """Return the message of that id; ``None`` if there is none, or nothing to say yet."""
        make = self._makers.get(int(number)) if math.isfinite(number) else None
        return make() if make else None

    def set_interval(self, number: float, microseconds: float) -> bool:
        """Set the interval of a message that is sent regularly, and return whether it is valid.

        Args:
            number: id of the message.
            microseconds: the interval; 0 for the usual one, -1 for never.
        """
        if number not in self._intervals or not microseconds >= -1.0:
            return False
        usual = _USUAL_INTERVALS[int(number)]
        seconds = max(_LEAST_INTERVAL, microseconds * 1e-6) if microseconds else usual
        self._intervals[int(number)] = math.inf if microseconds < 0.0 else seconds
        self._due[int(number)] = 0.0
        return True

    def due(self) -> list[Any]:
        """Return the messages that are due now."""
        now, messages = time.monotonic(), []
        for number, interval in self._intervals.items():
            if self._due[number] <= now and interval < math.inf:
                self._due[number] = now + interval
                messages.append(self.message(number))
        return [message for message in messages if message is not None]

    def _ms(self) -> int:
        return round(1e3 * (time.monotonic() - self._began)) % (1 << 32)

    def _flags(self) -> int:
        accepts = ACCEPTS_YAW_IN_EARTH_FRAME if self._gimbal.knows_north else 0
        return self._gimbal.setpoint.flags & 0x1F | YAW_IN_VEHICLE_FRAME | accepts

    def _status(self) -> Any:  # noqa: ANN401
        return mavlink.MAVLink_gimbal_manager_status_message(
            self._ms(), self._flags(), GIMBAL_ID, *self.holders[0], *self.holders[1]
        )

    def _attitude(self) -> Any:  # noqa: ANN401
        report = self._served.report()
        if not report.cycle.HasField("feedback_q"):
            return None
        roll, pitch, heading = self._gimbal.setpoint.base
        turned = mirrored(to_quaternion(report.cycle.feedback_q))
        x, y, z = to_vector(report.cycle.feedback_omega_body)
        failures = 0
        if report.feedback_age > _STALE or report.is_stale:
            failures |= mavlink.GIMBAL_DEVICE_ERROR_FLAGS_COMMS_ERROR
        if report.fault or self._gimbal.problem:
            failures |= mavlink.GIMBAL_DEVICE_ERROR_FLAGS_SOFTWARE_ERROR
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            0,
            0,
            max(0, self._ms() - round(1e3 * report.feedback_age)),
            self._flags(),
            multiply(of_angles((roll, pitch, 0.0)), turned),
            *(x, -y, -z),
            failures,
            heading if self._gimbal.knows_north else math.nan,
            math.nan,
            GIMBAL_ID,
        )

    def _manager(self) -> Any:  # noqa: ANN401
        ranges = self._gimbal.ranges
        return mavlink.MAVLink_gimbal_manager_information_message(
            self._ms(), ranges.capabilities, GIMBAL_ID, *ranges.announced()
        )

    def _device(self) -> Any:  # noqa: ANN401
        ranges = self._gimbal.ranges
        major, minor, patch = (int(part) for part in orientd.__version__.split(".")[:3])
        return mavlink.MAVLink_gimbal_device_information_message(
            self._ms(),
            b"orientd",
            self._driver.encode()[:31],
            self._served.name.encode()[:31],
            major | minor << 8 | patch << 16,
            0,
            0,
            ranges.capabilities & 0xFFFF,
            0,
            *ranges.announced(),
            GIMBAL_ID,
            ranges.capabilities,
        )


def _heartbeat() -> Any:  # noqa: ANN401
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GIMBAL, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )
