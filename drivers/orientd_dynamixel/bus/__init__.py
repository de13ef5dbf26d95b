"""The servos' bus: the vendor's SDK, what servos answer, and all of them read at once."""

from __future__ import annotations

from orientd_dynamixel.bus.group import TAIL_SHARE, Group, listen
from orientd_dynamixel.bus.reading import (
    BLOCK,
    HEALTH,
    RETURN_LEVEL,
    VELOCITY_UNIT,
    WATCHDOG_TRIPPED,
    Health,
    Reading,
    explain_error,
)
from orientd_dynamixel.bus.servo_bus import (
    ATTEMPTS,
    PATIENT_ATTEMPTS,
    READ_WAIT_S,
    OpenBus,
    ServoBus,
    open_bus,
)
