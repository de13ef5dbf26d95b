"""The published arms: link lengths, joint speeds and joint ranges of every model.

Sources:

- link lengths: Universal Robots, "DH Parameters for calculations of kinematics and dynamics"; the
  same figures as ``config/*/default_kinematics.yaml`` of Universal_Robots_ROS2_Description
  (2221ec0).  UR7e and UR12e have the arms of UR5e and UR10e.  Those of the UR15 are from the first
  source only; :math:`a_2 + a_3 + d_5` is its reach of 1.300 m, as it is for every other model;
- speeds and ranges: the user manuals, by ``config/*/joint_limits.yaml`` there, without the elbow's
  range of half a turn, which that file gives for a planner's sake.  The UR15's speeds are those of
  its data sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, radians, tau

from orientd_ur.kinematics import Links, Six


@dataclass(frozen=True, slots=True)
class ArmModel:
    """One model of arm.

    Attributes:
        name: in lower case, as in ``ur10e``.
        links: its lengths.
        speeds: largest speed of each joint, rad/s.
        ranges: how far each joint turns either way, rad.
    """

    name: str
    links: Links
    speeds: Six
    ranges: Six


_WHOLE_TURNS: Six = (tau, tau, tau, tau, tau, tau)
_ENDLESS_WRIST: Six = (tau, tau, tau, tau, tau, inf)


def _model(name: str, links: Sequence[float], degrees: Sequence[float], ranges: Six) -> ArmModel:
    base, shoulder, elbow, wrists = map(radians, degrees)
    return ArmModel(name, Links(*links), (base, shoulder, elbow, wrists, wrists, wrists), ranges)


_UR5E = (0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996)
_UR10E = (0.1807, 0.6127, 0.57155, 0.17415, 0.11985, 0.11655)
_SMALL, _MEDIUM = (180, 180, 180, 360), (180, 180, 180, 180)
_LARGE, _HEAVY = (120, 120, 180, 180), (120, 120, 150, 210)

MODELS: dict[str, ArmModel] = {
    model.name: model
    for model in (
        _model("ur3", (0.1519, 0.24365, 0.21325, 0.11235, 0.08535, 0.0819), _SMALL, _ENDLESS_WRIST),
        _model("ur5", (0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823), _MEDIUM, _WHOLE_TURNS),
        _model("ur10", (0.1273, 0.612, 0.5723, 0.163941, 0.1157, 0.0922), _LARGE, _WHOLE_TURNS),
        _model(
            "ur3e", (0.15185, 0.24355, 0.2132, 0.13105, 0.08535, 0.0921), _SMALL, _ENDLESS_WRIST
        ),
        _model("ur5e", _UR5E, _MEDIUM, _WHOLE_TURNS),
        _model("ur7e", _UR5E, _MEDIUM, _WHOLE_TURNS),
        _model("ur10e", _UR10E, _LARGE, _WHOLE_TURNS),
        _model("ur12e", _UR10E, _LARGE, _WHOLE_TURNS),
        _model("ur16e", (0.1807, 0.4784, 0.36, 0.17415, 0.11985, 0.11655), _LARGE, _WHOLE_TURNS),
        _model(
            "ur15",
            (0.2186, 0.6475, 0.5164, 0.1824, 0.1361, 0.1434),
            (180, 180, 240, 300),
            _WHOLE_TURNS,
        ),
        _model("ur20", (0.2363, 0.862, 0.7287, 0.201, 0.1593, 0.1543), _HEAVY, _WHOLE_TURNS),
        _model("ur30", (0.2363, 0.637, 0.5037, 0.201, 0.1593, 0.1543), _HEAVY, _WHOLE_TURNS),
    )
}
"""The published arms by name."""
