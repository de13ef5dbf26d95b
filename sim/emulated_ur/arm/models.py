"""The robots that can be emulated: their arms' tables and limits, and how controllers differ.

Denavit-Hartenberg parameters: Universal Robots, "DH Parameters for calculations of kinematics and
dynamics"; speeds and ranges: the user manuals, as in ``joint_limits.yaml`` of
Universal_Robots_ROS2_Description; numbers of the types: the primary interface's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from emulated_ur.variables import ProgramState


@dataclass(frozen=True, slots=True)
class Model:
    """One model of arm.

    Attributes:
        name: as on its sign.
        d, a: of the six joints, m.
        speeds: largest of each joint, rad/s.
        ranges: each joint turns so far either way, rad.
        kind: its type at the primary interface; UR7e and UR12e have that of UR5e and UR10e.
        dashboard_name: what the dashboard server calls it.
    """

    name: str
    d: tuple[float, ...]
    a: tuple[float, ...]
    speeds: tuple[float, ...]
    ranges: tuple[float, ...]
    kind: int
    dashboard_name: str

    @property
    def version(self) -> tuple[int, int, int, int]:
        """The software that its controller has unless told otherwise."""
        if self.name in ("UR3", "UR5", "UR10"):
            return (3, 15, 8, 106339)
        return (5, 12, 6, 1102099)


def _model(
    name: str, kind: int, lengths: Sequence[float], speeds: Sequence[int], *, endless: bool = False
) -> Model:
    d1, a2, a3, d4, d5, d6 = lengths
    wrist_3 = math.inf if endless else math.tau
    return Model(
        name,
        (d1, 0.0, 0.0, d4, d5, d6),
        (0.0, a2, a3, 0.0, 0.0, 0.0),
        tuple(math.radians(speed) for speed in (*speeds, speeds[3], speeds[3])),
        (*(math.tau,) * 5, wrist_3),
        kind,
        name.rstrip("e"),
    )


MODELS = {
    model.name.lower(): model
    for model in (
        _model("UR3", 3, (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
               (180, 180, 180, 360), endless=True),
        _model("UR5", 1, (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
               (180, 180, 180, 180)),
        _model("UR10", 2, (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
               (120, 120, 180, 180)),
        _model("UR3e", 3, (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
               (180, 180, 180, 360), endless=True),
        _model("UR5e", 1, (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
               (180, 180, 180, 180)),
        _model("UR7e", 1, (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
               (180, 180, 180, 180)),
        _model("UR10e", 2, (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
               (120, 120, 180, 180)),
        _model("UR12e", 2, (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
               (120, 120, 180, 180)),
        _model("UR16e", 4, (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
               (120, 120, 180, 180)),
        _model("UR15", 9, (0.2186, -0.6475, -0.5164, 0.1824, 0.1361, 0.1434),
               (180, 180, 240, 300)),
        _model("UR20", 7, (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
               (120, 120, 150, 210)),
        _model("UR30", 8, (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
               (120, 120, 150, 210)),
    )
}  # fmt: skip
"""Every model by its name in lower case."""


_NO_NUMBER = 1 << 32


def version_of(model: Model, text: str | None) -> tuple[int, int, int, int]:
    """Return the software version that *text* names, as in ``5.12.6``; else the model's.

    Raises:
        ValueError: it is not two to four numbers, or the model's controller cannot have it.
    """
    if not text:
        return model.version
    numbers = [int(part) if part.isdecimal() else _NO_NUMBER for part in text.split(".")]
    is_whole = 2 <= len(numbers) <= 4 and max(numbers) < _NO_NUMBER
    if not is_whole or (numbers[0] < 5) != (model.version[0] < 5):
        raise ValueError(f"a {model.name} has no PolyScope {text!r}")
    major, minor, bugfix, build = (*numbers, 0, 0)[:4]
    return major, minor, bugfix, build


@dataclass(frozen=True, kw_only=True)
class Behaviour:
    """What differs between robots, or is not known of real ones.

    Attributes:
        model: which arm the controller has.
        version: of the software; major, minor, bugfix, build.
        serial: digits only, as clients insist.
        protective_stop_leaves: runtime state a protective stop leaves the program in.
        unlock_after: s after which a protective stop may be unlocked.
        power_up: s from one robot mode to the next when powering on.
        program_start: s from the upload of a program until it plays.
        stops_on_breach: whether a joint over its limits stops the robot, or is merely clamped.
    """

    model: Model = MODELS["ur5e"]
    version: tuple[int, int, int, int] = (5, 12, 6, 1102099)
    serial: str = "20235500123"
    protective_stop_leaves: ProgramState = ProgramState.PAUSED
    unlock_after: float = 5.0
    power_up: float = 0.1
    program_start: float = 0.02
    stops_on_breach: bool = True

    @property
    def is_cb3(self) -> bool:
        """Whether this is PolyScope 3, which knows no remote control."""
        return self.version[0] < 5

    @property
    def has_dashboard(self) -> bool:
        """Whether there is a dashboard server; PolyScope X has none."""
        return self.version[0] < 10

    @property
    def cycle_ticks(self) -> int:
        """Ticks of 2 ms from one look at the inputs to the next: CB3 controllers have 8 ms."""
        return 4 if self.is_cb3 else 1
