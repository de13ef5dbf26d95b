"""The emulated robots: their arms, from ``models.txt``, and differences of controllers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from emulated_ur.variables import ProgramState


@dataclass(frozen=True, slots=True)
class Model:
    """One model of arm.

    Attributes:
        name: as on its type label.
        d, a: of the six joints, m.
        speeds: largest of each joint, rad/s.
        ranges: largest angle of each joint in either direction, rad.
        kind: its type at the primary interface.
        dashboard_name: its name at the dashboard server.
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
        """The default software of its controller."""
        if self.name in ("UR3", "UR5", "UR10"):
            return (3, 15, 8, 106339)
        return (5, 12, 6, 1102099)


def _model(line: str) -> Model:
    name, kind, *words = line.split()
    d1, a2, a3, d4, d5, d6, *angles = map(float, words)
    *speeds, wrist_3 = map(math.radians, angles)
    return Model(
        name,
        (d1, 0.0, 0.0, d4, d5, d6),
        (0.0, a2, a3, 0.0, 0.0, 0.0),
        (*speeds, speeds[3], speeds[3]),
        (*(math.tau,) * 5, wrist_3),
        int(kind),
        name.rstrip("e"),
    )


_TABLE = Path(__file__).with_name("models.txt").read_text(encoding="utf-8")
MODELS = {
    model.name.lower(): model
    for model in (_model(line) for line in _TABLE.splitlines() if not line.startswith("#"))
}
"""Every model by its name in lower case."""


_NO_NUMBER = 1 << 32


def version_of(model: Model, text: str | None) -> tuple[int, int, int, int]:
    """Return the software version *text*, as in ``5.12.6``; the model's by default.

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
    """Differences between robots, and behaviour that is unknown for real ones.

    Attributes:
        model: the controller's arm.
        version: of the software; major, minor, bugfix, build.
        serial: digits only, as clients require.
        protective_stop_leaves: runtime state of the program after a protective stop.
        unlock_after: s after which a protective stop may be unlocked.
        power_up: s from one robot mode to the next when powering on.
        program_start: s from the upload of a program until it plays.
        stops_on_breach: whether a joint over its limits stops the robot, or is only clamped.
        smooths_servo: whether a servo command is smoothed, or reached in a cycle.
    """

    model: Model = MODELS["ur5e"]
    version: tuple[int, int, int, int] = (5, 12, 6, 1102099)
    serial: str = "20235500123"
    protective_stop_leaves: ProgramState = ProgramState.PAUSED
    unlock_after: float = 5.0
    power_up: float = 0.1
    program_start: float = 0.02
    stops_on_breach: bool = True
    smooths_servo: bool = True

    @property
    def software(self) -> str:
        """The version as it is written."""
        return ".".join(map(str, self.version))

    @property
    def is_cb3(self) -> bool:
        """Whether this is PolyScope 3, which knows no remote control."""
        return self.version[0] < 5

    @property
    def has_dashboard(self) -> bool:
        """Whether there is a dashboard server; PolyScope X has none."""
        return self.version[0] < 10

    @property
    def has_interpreter(self) -> bool:
        """Whether its programs can enter interpreter mode."""
        return self.version >= (5, 10)

    @property
    def cycle_ticks(self) -> int:
        """Ticks of 2 ms between two readings of the inputs: CB3 controllers have 8 ms."""
        return 4 if self.is_cb3 else 1
