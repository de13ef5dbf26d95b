"""What targets that are followed ask of the arm's joints, from cycle to cycle.

Nothing is planned of targets.  So the joints are predicted for each setpoint and for the stop that
would follow it, by the published kinematics of the model: from where the arm stands the tool is
seen as it stands, so what the arm's own calibration differs by is part of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from orientd.driver import ComingPose, Joints, Quaternion, Vector3
from orientd_ur.arm import Arm
from orientd_ur.joint_path import SPEED_SHARE, UNITS, follow

# A stop is looked at in a few instants only; between them a joint is faster.
_STOP_SPEED_SHARE = 0.9
_STOP_ACCELERATION_SHARE = 0.5
# The first cycle of it is looked at as it will be.
_FIRST_ACCELERATION_SHARE = 0.7
# The arm is behind what is sent, and stops at the very end of a joint's range.
_RANGE_MARGIN = 0.02
_STILL = 1e-9

NEAREST = {"wrist": 0.05, "elbow": 0.1, "shoulder": 0.05}
"""How near to each kind of singularity targets are followed, in its own unit.

Farther away than a planned path may go: a stop has to begin before it is known where it ends.
"""


class Following:
    """The joints of what was sent last, and what comes next of them.

    Args:
        arm: whose joints they are.
        joints: of the arm somewhere, rad.
        pose: orientation and position (m) of the tool there.
        period: of the cycles, s.
    """

    def __init__(
        self, arm: Arm, joints: Sequence[float], pose: tuple[Quaternion, Vector3], period: float
    ) -> None:
        self._arm = arm.seen(tuple(joints), pose)
        self._period = period
        self._seed: Sequence[float] = joints
        self._sent: list[tuple[Quaternion, Vector3]] = [pose, pose]
        self._looked: tuple[tuple[Quaternion, Vector3], Joints] | None = None
        self._joints: Joints | None = None
        self._rates: Sequence[float] = (0.0,) * 6

    def stream(self, q: Quaternion, position: Vector3, joints: Sequence[float]) -> None:
        """Note a pose that was sent of a planned motion, and the joints measured meanwhile, rad."""
        self._sent = [self._sent[1], (q, position)]
        self._seed, self._joints = joints, None

    def took(self, q: Quaternion, position: Vector3) -> None:
        """Note a pose that was sent of targets that are followed."""
        self._sent = [self._sent[1], (q, position)]
        before, looked = self._joints, self._looked
        if before is None:
            return
        if looked is not None and looked[0] == (q, position):
            found: Joints | None = looked[1]
        else:
            (found,) = self._solve([(q, position)], before)
        if found is not None:
            h = self._period
            self._joints = found
            self._rates = tuple((a - b) / h for a, b in zip(found, before, strict=True))

    def look(self, coming: Sequence[ComingPose]) -> str:
        """Return why the joints cannot follow *coming*, or an empty string."""
        if self._joints is None:
            self._begin()
        near, rates = self._joints, self._rates
        if near is None:
            return "the arm does not reach where it was sent"
        before = self._period
        speed_share, change_share = SPEED_SHARE, 1.0
        reserves = self._arm.kinematics.reserve(near)
        poses = [(q, position) for _, q, position in coming]
        # One after the other: what is not followed is mostly found in the first.
        path = follow(self._arm, poses, near)
        self._looked = None
        for place, ((seconds, _, _), joints) in enumerate(zip(coming, path, strict=False)):
            if joints is not None and not place:
                self._looked = poses[0], joints
            if joints is None:
                return "the arm does not reach there"
            moved = tuple((a - b) / seconds for a, b in zip(joints, near, strict=True))
            since = 0.5 * (seconds + before)
            problem = self._turning(joints, moved, rates, since, speed_share, change_share)
            problem = problem or self._nearing(joints, reserves)
            if problem:
                return problem
            near, rates, before = joints, moved, seconds
            speed_share = _STOP_SPEED_SHARE
            change_share = _STOP_ACCELERATION_SHARE if place else _FIRST_ACCELERATION_SHARE
        return ""

    def _turning(
        self,
        joints: Sequence[float],
        moved: Sequence[float],
        rates: Sequence[float],
        since: float,
        speed_share: float,
        change_share: float,
    ) -> str:
        """Return which joint is too fast, changes its speed too fast, or turns too far."""
        arm = self._arm
        for k, (name, low, high, velocity, acceleration, _) in enumerate(arm.axes):
            speed, most = abs(moved[k]), speed_share * velocity
            if speed > most and speed > abs(rates[k]):
                return f"{name} would turn at {speed:.3g} rad/s, the limit is {most:.3g}"
            change, most = abs(moved[k] - rates[k]) / since, change_share * acceleration
            if change > most:
                return (
                    f"the speed of {name} would change by {change:.3g} rad/s^2, the limit is "
                    f"{most:.3g}"
                )
            if (joints[k] > high - _RANGE_MARGIN and moved[k] > _STILL) or (
                joints[k] < low + _RANGE_MARGIN and moved[k] < -_STILL
            ):
                return f"{name} is at the end of its range, {joints[k]:.4g} rad"
        return ""

    def _nearing(self, joints: Sequence[float], reserves: Mapping[str, float]) -> str:
        """Return which singularity is too near, and nearer than by *reserves*."""
        for kind, reserve in self._arm.kinematics.reserve(joints).items():
            if reserve < NEAREST[kind] and reserve < reserves[kind]:
                return f"the {kind} would be {reserve:.3g} {UNITS[kind]} from its singularity"
        return ""

    def refusal(self, q: Quaternion, position: Vector3, joints: Sequence[float]) -> str:
        """Return why the arm cannot be at a target, or an empty string.

        Args:
            q: orientation of the tool.
            position: of the tool, m.
            joints: as they are now, rad; empty where they are not known.
        """
        (found,) = self._solve([(q, position)], joints or self._seed)
        if found is None:
            return "the arm does not reach there"
        for (name, low, high, *_), angle in zip(self._arm.axes, found, strict=True):
            if not low <= angle <= high:
                most = high if angle > high else low
                return f"{name} would have to turn to {angle:.4g} rad, its range ends at {most:.4g}"
        for kind, reserve in self._arm.kinematics.reserve(found).items():
            if reserve < NEAREST[kind]:
                return (
                    f"the {kind} is {reserve:.3g} {UNITS[kind]} from its singularity there, the "
                    f"least is {NEAREST[kind]:g}"
                )
        return ""

    def _begin(self) -> None:
        """Find the joints of the last two poses that were sent."""
        first, last = self._solve(self._sent, self._seed)
        if first is not None and last is not None:
            h = self._period
            self._rates = tuple((a - b) / h for a, b in zip(last, first, strict=True))
        self._joints = last

    def _solve(
        self, poses: Sequence[tuple[Quaternion, Vector3]], near: Sequence[float]
    ) -> list[Joints | None]:
        found = list(follow(self._arm, poses, near))
        return found + [None] * (len(poses) - len(found))
