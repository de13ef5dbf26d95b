"""Short for what tests plan often: a new aim, and where a motion ends."""

from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.rotation import check_unit


def retarget(target, *, start, limits, period, position=None, motion_id=None, **fields):
    """Return the motion from a state, moving or not, to an orientation."""
    keyframe = Keyframe(tuple(check_unit(target).tolist()), position=position)
    request = MotionRequest([keyframe], **fields)
    return plan(request, start=start, limits=limits, period=period, motion_id=motion_id)


def end_state(motion):
    """Return the state of a motion at its last keyframe."""
    return motion.path.state(motion.end_time)
