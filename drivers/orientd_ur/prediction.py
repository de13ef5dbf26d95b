"""What planning asks of the arm: its joints over a path, where it stands, how it looks.

Used by drivers that are not open, in processes that keep no cycle.  The controller is asked for
where it commands the arm to be each time, for which arm it has once, and again when the two do not
agree.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from math import hypot

from orientd.driver import Feedback, Quaternion, Vector3
from orientd.errors import LinkError, PlanError
from orientd.floats import difference, exp
from orientd_ur.arm import Arm, ask, published
from orientd_ur.following import Following
from orientd_ur.joint_path import examine, tool_pose
from orientd_ur.options import UrOptions
from orientd_ur.probe import Place, whereabouts
from orientd_ur.sockets import Address

TIMEOUT = 0.8
"""s that the controller has for all that is asked of it in one plan."""

_NO_TOOL = (0.0,) * 6
# Where an arm's own calibration is not known, its pose is off by some millimetres.
_FARTHEST = 0.01
_FURTHEST_TURN = 0.02
_ASK_AGAIN = 5.0


class Prediction:
    """What is known of a robot without being in command of it.

    Args:
        options: of the driver.
        address: of the robot.
    """

    def __init__(self, options: UrOptions, address: Address) -> None:
        self._options = options
        self._address = address
        self._arm: Arm | None = None
        self._asked = -_ASK_AGAIN

    def examine(
        self,
        times: Sequence[float],
        poses: Sequence[tuple[Quaternion, Vector3]],
        joints: Sequence[float],
        *,
        is_offline: bool,
    ) -> None:
        """Refuse a path on which a joint would be too fast, or a singularity too near.

        Args:
            times: path times, s.
            poses: orientation and position of the tool at each.
            joints: near where it begins, rad; empty for where the robot is, or is said to be.
            is_offline: whether to take the arm and its tool from the options.

        Raises:
            PlanError: the time and the joint; or the robot does not say where it is.
        """
        if not self._options.check_joints:
            return
        if is_offline:
            arm, tcp_offset = self._named(), self._options.tcp_offset or _NO_TOOL
            joints = joints or self._options.start_joints
        else:
            try:
                arm, place = self.look()
            except LinkError as error:
                raise PlanError(f"cannot predict the joints: {error}") from error
            joints, tcp_offset = joints or place.joints, place.tcp_offset
        examine(arm, times, poses, joints, tcp_offset=tcp_offset)

    def look(self) -> tuple[Arm, Place]:
        """Return the robot's arm, and where it is commanded to be.

        Raises:
            LinkError: it does not answer in time, or what it says does not fit together.
        """
        ends = time.monotonic() + TIMEOUT
        address = self._address.get(TIMEOUT)
        left, offset = max(ends - time.monotonic(), 0.05), self._options.tcp_offset
        place = whereabouts(address, timeout=left, tcp_offset=offset)
        if self._arm is None or not _fits(self._arm, place):
            # Another robot may have taken the place of the one that was asked.
            self._arm = self._identify(address, max(ends - time.monotonic(), 0.05))
        # The tool of the options is set only once the device is enabled.
        if place.is_offset_told and not _fits(self._arm, place):
            raise LinkError(
                f"{self._options.host} says where its joints and its tool are, and they do not "
                f"agree for the {self._arm.name}; `check_joints = false` plans without its joints"
            )
        return self._arm, place

    def confirm(self, address: str) -> Arm | None:
        """Return the arm that the controller has; ``None`` where its joints are not to be checked.

        ``None``, too, where neither the controller nor the options say which arm it is.

        Raises:
            LinkError: it has another than the options name.
        """
        if not self._options.check_joints:
            return None
        try:
            return self._identify(address, TIMEOUT)
        except LinkError:
            if self._options.model is not None:
                raise
            return None

    def following(self, period: float) -> Following | None:
        """Return what targets are judged by; ``None`` where the joints are not to be checked.

        Raises:
            PlanError: the robot does not say where it is, or which arm it has.
        """
        if not self._options.check_joints:
            return None
        try:
            arm, place = self.look()
        except LinkError as error:
            raise PlanError(f"cannot predict the joints: {error}") from error
        x, y, z, rx, ry, rz = place.pose
        return Following(arm, place.joints, (exp((rx, ry, rz)), (x, y, z)), period)

    def start(self, *, from_device: bool) -> Feedback:
        """Return where plans begin that are made without the daemon.

        Raises:
            LinkError: the robot is asked, and does not answer.
            PlanError: it is not asked, and the options do not say which arm it is.
        """
        if from_device:
            arm, place = self.look()
            joints, tcp_offset = place.joints, place.tcp_offset
        else:
            arm, joints = self._named(), self._options.start_joints
            tcp_offset = self._options.tcp_offset or _NO_TOOL
        q, position = tool_pose(arm.kinematics, joints, tcp_offset)
        return Feedback(0, q, position=position, joints=tuple(joints))

    def outline(self, joints: tuple[float, ...]) -> Sequence[Sequence[Vector3]]:
        """Return the arm's links from the base to the flange; nothing while it is not known."""
        arm = self._arm or (published(self._options.model) if self._options.model else None)
        if arm is None:
            self._ask_aside()
            return ()
        return (arm.kinematics.frames(joints),)

    def _ask_aside(self) -> None:
        """Have the controller asked for its arm by somebody who may wait."""
        now = time.monotonic()
        if now - self._asked < _ASK_AGAIN:
            return
        self._asked = now

        def ask_for_arm() -> None:
            try:
                self._arm = self._identify(self._address.get(TIMEOUT), TIMEOUT)
            except LinkError:
                return  # asked again after a while, as long as somebody looks

        threading.Thread(target=ask_for_arm, daemon=True).start()

    def _identify(self, address: str, timeout: float) -> Arm:
        """Return the arm that the controller has.

        Raises:
            LinkError: it does not say and the options do not either, or they disagree.
        """
        model = self._options.model
        try:
            arm = ask(address, timeout)
        except LinkError as error:
            if model is not None:
                return published(model)
            raise LinkError(
                f"{error}; allow the primary client interface under Settings > Security > "
                "Services, name `model`, or plan without its joints (`check_joints = false`)"
            ) from error
        if model is not None and arm.links != model.links:
            raise LinkError(
                f"{self._options.host} has a {arm.name}, `model` says {model.name}: change it, or "
                "leave it out"
            )
        return arm

    def _named(self) -> Arm:
        model = self._options.model
        if model is None:
            raise PlanError(
                "which arm it is is not known without the robot: name `model` in the device's "
                "options, or ask the robot"
            )
        return published(model)


def _fits(arm: Arm, place: Place) -> bool:
    q, position = tool_pose(arm.kinematics, place.joints, place.tcp_offset)
    x, y, z, rx, ry, rz = place.pose
    off = hypot(position[0] - x, position[1] - y, position[2] - z)
    return off < _FARTHEST and hypot(*difference(q, exp((rx, ry, rz)))) < _FURTHEST_TURN
