"""What a path of the tool asks of the arm's joints, before anything moves.

The joints are followed from where they are, record by record, on the branch they begin on.  A
path that the arm does not reach, a joint that would have to turn faster than it can or further
than it can, and a singularity passed too near are refused with the time and the joint.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from orientd.driver import Joints, Quaternion, Vector3
from orientd.errors import LimitError, LimitKind, PlanError
from orientd_ur.arm import JOINT_NAMES, Arm

SPEED_SHARE = 0.98
"""How much of the joint speed a path may use; between the poses that are looked at it is more."""

# Nearer than this a joint turns many times faster than the tool, whatever the present path asks.
LEAST_RESERVE = {"wrist": 0.02, "elbow": 0.02, "shoulder": 0.02}
UNITS = {"wrist": "rad", "elbow": "rad", "shoulder": "m"}
_ADVICE = {
    "wrist": "begin with wrist 2 bent, or turn about another axis",
    "elbow": "move the tool nearer to the base",
    "shoulder": "move the tool away from the axis of the base",
}
# A solution further away than this is another branch: the arm would have to jump.
_LONGEST_STEP = 0.5


@dataclass(frozen=True, slots=True)
class Extreme:
    """The worst of one quantity.

    Attributes:
        value: in rad/s for a joint, in the unit of the reserve otherwise.
        time: when, s from the beginning of the path.
    """

    value: float
    time: float


@dataclass(frozen=True, slots=True)
class JointReport:
    """What a path asks of the joints.

    Attributes:
        speeds: the largest speed of each joint, by name.
        reserves: the least distance from each kind of singularity, by name.
        end: where the joints end, rad.
    """

    speeds: dict[str, Extreme]
    reserves: dict[str, Extreme]
    end: Joints


def follow(
    arm: Arm, poses: Iterable[tuple[Quaternion, Vector3]], start: Sequence[float]
) -> Iterator[Joints | None]:
    """Yield the joints for each pose of the tool, continuously from *start*, rad.

    Yields:
        ``None``, and then nothing more, if the arm does not reach.
    """
    near: Joints = tuple(start)
    for q, position in poses:
        joints = arm.nearest(q, position, near)
        yield joints
        if joints is None:
            return
        near = joints


def examine(
    arm: Arm,
    times: Sequence[float],
    poses: Iterable[tuple[Quaternion, Vector3]],
    start: Sequence[float],
) -> JointReport:
    """Return what a path asks of the joints, or refuse it.

    Args:
        arm: whose joints they are.
        times: of the poses, s, increasing.
        poses: orientation and position (m) of the tool in the base.
        start: the joints as they are now, rad.

    Raises:
        LimitError: a joint would turn too fast or too far, or a singularity is too near.
        PlanError: the arm does not reach a pose, or not without a jump.
    """
    speeds = {name: Extreme(0.0, times[0] if len(times) else 0.0) for name in JOINT_NAMES}
    reserves: dict[str, Extreme] = {}
    before, before_time = tuple(start), None
    path = follow(arm, poses, start)
    for time, joints in zip(times, path, strict=False):
        if joints is None:
            raise PlanError(f"the arm does not reach the pose at {time:.4f} s")
        for name, value in arm.kinematics.reserve(joints).items():
            if name not in reserves or value < reserves[name].value:
                reserves[name] = Extreme(value, time)
        for (name, low, high, *_), here, there in zip(arm.axes, before, joints, strict=True):
            if before_time is not None:
                if abs(there - here) > _LONGEST_STEP:
                    raise PlanError(f"the joint {name} would have to jump at {time:.4f} s")
                rate = abs(there - here) / (time - before_time)
                if rate > speeds[name].value:
                    speeds[name] = Extreme(rate, time)
            if not low <= there <= high:
                # What is too fast before that is the first thing wrong with the path.
                _refuse_fast(speeds, arm)
                raise LimitError(
                    f"angle of joint {name}", abs(there), high if there > high else abs(low), time,
                    "rad", "turn less far (a turn by a shorter `--duration`), or unwind it first",
                    kind=LimitKind.RANGE,
                )  # fmt: skip
        before, before_time = joints, time
    _refuse_fast(speeds, arm)
    _refuse_singular(reserves)
    return JointReport(speeds, reserves, before)


def _refuse_fast(speeds: dict[str, Extreme], arm: Arm) -> None:
    limits = {axis.name: axis.velocity for axis in arm.axes}
    name, worst = max(speeds.items(), key=lambda entry: entry[1].value / limits[entry[0]])
    limit = SPEED_SHARE * limits[name]
    if worst.value > limit:
        raise LimitError(
            f"speed of joint {name}", worst.value, limit, worst.time, "rad/s",
            "allow the motion more time, or keep away from singularities", kind=LimitKind.VELOCITY,
        )  # fmt: skip


def _refuse_singular(reserves: dict[str, Extreme]) -> None:
    for kind, least in reserves.items():
        if least.value < LEAST_RESERVE[kind]:
            raise PlanError(
                f"the {kind} comes within {least.value:.4f} {UNITS[kind]} of its singularity at "
                f"{least.time:.4f} s, at least {LEAST_RESERVE[kind]:g} are needed; {_ADVICE[kind]}"
            )
