"""Retargeting: a new aim for a device that is on its way to another one."""

from __future__ import annotations

from numpy.typing import ArrayLike

from orientd.planner.limits import Limits
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.request import Keyframe, MotionRequest, State, Vector3
from orientd.rotation import check_unit


def retarget(
    target: ArrayLike,
    *,
    start: State,
    limits: Limits,
    period: float,
    end_velocity: Vector3 | None = None,
    position: Vector3 | None = None,
    motion_id: str | None = None,
) -> Motion:
    """Return the motion from a state, moving or not, to an orientation, by the shortest way found.

    It is :func:`~orientd.planner.planning.plan` of a single keyframe.  Which way round it turns,
    and whether it swings out first, follows from the present motion.

    Args:
        target: orientation ``(w, x, y, z)``, tool to world.
        start: where the device is commanded to be; see :meth:`Motion.state_at`.
        limits: to keep.
        period: the device's cycle, s.
        end_velocity: angular velocity at the target, body frame, rad/s, from which the motion goes
            on to rest; ``None`` comes to rest at the target.
        position: of the tool at the target, m; ``None`` lets it come to rest where it can.
        motion_id: names the motion; by default a new random name.

    Raises:
        ValueError: the target is not a unit quaternion.
        PlanError: the end velocity is one that the limits do not permit, or *start* breaks the
            limits by itself.
    """
    w, x, y, z = check_unit(target).tolist()
    keyframe = Keyframe((w, x, y, z), position=position)
    request = MotionRequest([keyframe], end_velocity=end_velocity)
    return plan(request, start=start, limits=limits, period=period, motion_id=motion_id)
