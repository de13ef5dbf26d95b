"""Plan motions: from a request to an immutable :class:`Motion` with its certificate.

:func:`plan` is the way in.  Everything a request is made of is checked when it is made; what a
motion promises is in its :class:`Certificate`.
"""

from orientd.planner.certificate import Certificate, Peak
from orientd.planner.limits import DEFAULT_LIMITS, Limits
from orientd.planner.motion import RECORD_FLOATS, Motion
from orientd.planner.path import Samples
from orientd.planner.plan import plan
from orientd.planner.presets import PRESETS
from orientd.planner.request import DEFAULT_METHOD, Keyframe, MotionRequest, State
from orientd.planner.shaped import reshaped

__all__ = [
    "DEFAULT_LIMITS",
    "DEFAULT_METHOD",
    "PRESETS",
    "RECORD_FLOATS",
    "Certificate",
    "Keyframe",
    "Limits",
    "Motion",
    "MotionRequest",
    "Peak",
    "Samples",
    "State",
    "plan",
    "reshaped",
]
