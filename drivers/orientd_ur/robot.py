"""The arm of a robot and its pose, without taking control.

Each time, the controller is asked for the commanded pose.  It is asked for its arm once, and again
if the two do not agree.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cached_property

from orientd.errors import LinkError, PlanError
from orientd.floats import difference, norm, plus
from orientd_ur.arm import Arm
from orientd_ur.options import UrOptions
from orientd_ur.pose import pose_of
from orientd_ur.primary import ask
from orientd_ur.probe import Place, whereabouts
from orientd_ur.wire import numeric_address

_TIMEOUT = 0.8
"""Time for all answers of the controller in one plan, s."""

# Without an arm's own calibration, its pose is off by some millimetres.
_FARTHEST = 0.01
_FURTHEST_TURN = 0.02


class Robot:
    """One robot, as its options and its controller describe it.

    Args:
        options: of the driver.
    """

    def __init__(self, options: UrOptions) -> None:
        self._options = options
        self._arm: Arm | None = None

    @cached_property
    def address(self) -> str:
        """Its address; the resolver is asked once.

        Raises:
            LinkError: the name is unknown.
        """
        return numeric_address(self._options.host)

    def look(self) -> tuple[Arm, Place]:
        """Return the robot's arm with its tool, and its commanded pose.

        Raises:
            LinkError: it does not answer in time, or its answers do not agree.
        """
        ends = time.monotonic() + _TIMEOUT
        place = whereabouts(self.address, timeout=_TIMEOUT)
        if self._arm is None or not _fits(self._arm, place):
            # Another robot may have replaced the previous one.
            self._arm = self.identify(max(ends - time.monotonic(), 0.05))
            if not _fits(self._arm, place):
                raise LinkError(
                    f"{self._options.host} says where its joints and its tool are, and they do not "
                    f"agree for the {self._arm.name}; `check_joints = false` plans without its "
                    "joints"
                )
        return self._arm.seen(place.joints, place.pose), place

    def identify(self, timeout: float = _TIMEOUT) -> Arm:
        """Return the controller's arm, without a tool.

        Raises:
            LinkError: neither the controller nor the options name it, or they disagree.
        """
        model, chosen = self._options.model, self._options
        try:
            arm = ask(self.address, timeout)
        except LinkError as error:
            if model is None:
                raise LinkError(
                    f"{error}; allow the primary client interface under Settings > Security > "
                    "Services, name `model`, or plan without its joints (`check_joints = false`)"
                ) from error
            arm = model.arm()
        if model is not None and arm.kinematics.links != model.links:
            raise LinkError(
                f"{chosen.host} has a {arm.name}, `model` says {model.name}: change it, or leave "
                "it out"
            )
        return arm.slower(chosen.joint_acceleration)

    def named(self) -> Arm:
        """Return the arm and the tool in the options.

        Raises:
            PlanError: they do not name the arm.
        """
        model, tool = self._options.model, self._options.tcp_offset
        if model is None:
            raise PlanError(
                "which arm it is is not known without the robot: name `model` in the device's "
                "options, or ask the robot"
            )
        arm = model.arm().slower(self._options.joint_acceleration)
        arm = replace(arm, start=self._options.start_joints)
        return arm if tool is None else replace(arm, tool=pose_of(tool))


def _fits(arm: Arm, place: Place) -> bool:
    """Whether joints and pose are consistent with the tool that the controller reports."""
    if place.tool is None:
        return True
    turn, offset = arm.seen(place.joints, place.pose).tool
    off = norm(plus(offset, place.tool[1], -1.0))
    return off < _FARTHEST and norm(difference(turn, place.tool[0])) < _FURTHEST_TURN
