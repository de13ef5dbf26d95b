"""Plan smooth orientation motion for robots and stream it, cycle by cycle, to hardware."""

from __future__ import annotations

TYPE_CHECKING = False  # of typing, without loading it: a stop from the shell waits for this
if TYPE_CHECKING:
    from typing import Any

    from orientd import curves, plots
    from orientd.client.playing import Playing, PlayTiming
    from orientd.client.robot import Robot, connect
    from orientd.model.limits import DEFAULT_LIMITS, Limits
    from orientd.model.request import Frame, Keyframe, MotionRequest, Pose
    from orientd.planner.motion import Motion
    from orientd.planner.offline import plan_many
    from orientd.planner.offline import plan_offline as plan
    from orientd.planner.saved import load_motion
    from orientd.planner.state import State
    from orientd.protocol.control_pb2 import OnTarget
    from orientd.protocol.reports import samples, word
    from orientd.rotation.convert import Quaternion

__all__ = [
    "DEFAULT_LIMITS",
    "Frame",
    "Keyframe",
    "Limits",
    "Motion",
    "MotionRequest",
    "OnTarget",
    "PlayTiming",
    "Playing",
    "Pose",
    "Quaternion",
    "Robot",
    "State",
    "__version__",
    "connect",
    "curves",
    "load_motion",
    "plan",
    "plan_many",
    "plots",
    "samples",
    "word",
]

__version__ = "0.2.0"

# The servo process imports this package too and must not pay for gRPC and NumPy.
_HOMES = {
    "DEFAULT_LIMITS": "orientd.model.limits:DEFAULT_LIMITS",
    "Frame": "orientd.model.request:Frame",
    "Keyframe": "orientd.model.request:Keyframe",
    "Limits": "orientd.model.limits:Limits",
    "Motion": "orientd.planner.motion:Motion",
    "MotionRequest": "orientd.model.request:MotionRequest",
    "OnTarget": "orientd.protocol.control_pb2:OnTarget",
    "PlayTiming": "orientd.client.playing:PlayTiming",
    "Playing": "orientd.client.playing:Playing",
    "Pose": "orientd.model.request:Pose",
    "Quaternion": "orientd.rotation.convert:Quaternion",
    "Robot": "orientd.client.robot:Robot",
    "State": "orientd.planner.state:State",
    "connect": "orientd.client.robot:connect",
    "curves": "orientd.curves",
    "load_motion": "orientd.planner.saved:load_motion",
    "plan": "orientd.planner.offline:plan_offline",
    "plan_many": "orientd.planner.offline:plan_many",
    "plots": "orientd.plots",
    "samples": "orientd.protocol.reports:samples",
    "word": "orientd.protocol.reports:word",
}

_MOVED = {
    "connect_fleet": "orientd_fleet.client.connect_fleet",
    "satellite_pass": "orientd_rotctld.satellite_pass",
}
"""Names of version 0.2 and where they are now."""


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the signature PEP 562 asks for
    if name in _MOVED:
        # `from orientd import` hides the message of an AttributeError.
        raise ImportError(f"orientd.{name} is now {_MOVED[name]}")
    if name not in _HOMES:
        raise AttributeError(f"module 'orientd' has no attribute {name!r}")
    from importlib import import_module

    module, _, offered = _HOMES[name].partition(":")
    found = import_module(module)
    return getattr(found, offered) if offered else found
