"""Whether a plan that was kept still begins where its device is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.errors import StartError
from orientd.floats import difference, norm

if TYPE_CHECKING:
    from orientd.daemon.device import Device

if TYPE_CHECKING:
    from orientd.daemon.planners import PlannedMotion

START_TOLERANCE = 1e-6
"""How far from where the device is commanded to be a kept plan may begin, rad and m."""


def check_start(device: Device, motion: PlannedMotion) -> None:
    """Refuse *motion* unless it begins where *device*, at rest, is commanded to be.

    Raises:
        StateError: the device is not holding.
        StartError: the motion begins with another orientation, position or axis angles.
    """
    here, begin = device.commanded(), motion.state_at(0)
    turn = norm(difference(here.q.tolist(), begin.q.tolist()))
    if turn > START_TOLERANCE:
        raise StartError(
            f"the motion begins {turn:.6g} rad from where device {device.name!r} is commanded "
            f"to be; plan it again"
        )
    if not device.is_at(motion.facts.first_joints):
        raise StartError(
            f"the motion begins with other axis angles than those of device {device.name!r}; "
            "plan it again"
        )
    away = float(abs(here.position - begin.position).max())
    if away > START_TOLERANCE:
        raise StartError(
            f"the motion begins {away:.6g} m from where device {device.name!r} is commanded "
            f"to be; plan it again"
        )
