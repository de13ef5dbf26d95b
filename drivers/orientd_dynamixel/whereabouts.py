"""Where a servo is, asked alone and outside of the cycle: the one place where goals come from.

What it reports must come twice, and be where the servo can be (:meth:`.Axis.doubt`).
"""

from __future__ import annotations

from orientd.errors import DeviceFaultError
from orientd_dynamixel.axis import Axis
from orientd_dynamixel.bus import PATIENT_ATTEMPTS, ServoBus

TORQUE, GOAL, POSITION = 64, 116, 132


class DoubtError(DeviceFaultError):
    """A servo reports a position at which it cannot be."""


def present_position(bus: ServoBus, axis: Axis) -> int:
    """Return where a servo is, in its ticks.

    Raises:
        LinkError: it does not answer.
        DoubtError: it reports a position at which it cannot be.
    """
    servo, last = axis.options.id, None
    problem = "does not report the same position twice"
    for _ in range(PATIENT_ATTEMPTS):
        position = bus.read(servo, POSITION, 4, is_signed=True, attempts=PATIENT_ATTEMPTS)
        if last is not None and abs(position - last) <= axis.play:
            is_driven = bool(bus.read(servo, TORQUE, 1, attempts=PATIENT_ATTEMPTS))
            if is_driven:
                axis.goal = bus.read(servo, GOAL, 4, is_signed=True, attempts=PATIENT_ATTEMPTS)
            problem = axis.doubt(position, is_driven=is_driven)
            if not problem:
                return position
        last = position
    raise DoubtError(
        f"servo {servo} ({axis.options.name}) {problem}; nothing is moved by that: turn the axis a "
        "little by hand with the supply off, then reset"
    )
