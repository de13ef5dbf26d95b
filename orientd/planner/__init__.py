"""Plan motions: from a request to an immutable :class:`Motion` with its certificate.

:func:`plan` is the way in.  Everything a request is made of is checked when it is made; what a
motion promises is in its :class:`Certificate`.

Names are loaded when they are first asked for: limits need none of what plans, and a daemon that
has not planned yet stays small.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from orientd.planner.blending import blend
    from orientd.planner.certificate import Certificate, Peak
    from orientd.planner.limits import DEFAULT_LIMITS, Limits
    from orientd.planner.motion import Motion
    from orientd.planner.path import Samples
    from orientd.planner.planning import plan
    from orientd.planner.presets import PRESETS
    from orientd.planner.recorded import RECORD_FLOATS, MotionFacts, RecordedMotion
    from orientd.planner.request import DEFAULT_METHOD, Keyframe, MotionRequest, State
    from orientd.planner.shaped import reshaped

_HOMES = {
    "DEFAULT_LIMITS": "limits",
    "DEFAULT_METHOD": "request",
    "PRESETS": "presets",
    "RECORD_FLOATS": "recorded",
    "Certificate": "certificate",
    "Keyframe": "request",
    "Limits": "limits",
    "Motion": "motion",
    "MotionFacts": "recorded",
    "MotionRequest": "request",
    "Peak": "certificate",
    "RecordedMotion": "recorded",
    "Samples": "path",
    "State": "request",
    "blend": "blending",
    "plan": "planning",
    "reshaped": "shaped",
}

__all__ = [
    "DEFAULT_LIMITS",
    "DEFAULT_METHOD",
    "PRESETS",
    "RECORD_FLOATS",
    "Certificate",
    "Keyframe",
    "Limits",
    "Motion",
    "MotionFacts",
    "MotionRequest",
    "Peak",
    "RecordedMotion",
    "Samples",
    "State",
    "blend",
    "plan",
    "reshaped",
]


def __getattr__(name: str) -> object:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(f"{__name__}.{home}"), name)
    globals()[name] = found
    return found
