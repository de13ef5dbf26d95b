"""The file of a fleet motion: a motion for each of several devices of several daemons.

.. code-block:: yaml

    start_in: 1.0                  # s from the end of planning to the start; default 0.5
    motions:
      - daemon: arm-1
        device: arm                # if the daemon has several
        motion: {keyframes: [{rotation_vector: [0, 0, 0.5]}]}
      - daemon: arm-2
        file: turn.yaml            # in the folder of this file
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from orientd import motion_file
from orientd.errors import RequestError
from orientd.structured_text import read_structured

if TYPE_CHECKING:
    from orientd.planner import MotionRequest

START_IN = 0.5
"""Time from the end of planning to the start unless a plan says otherwise, s."""

_KEYS = {"daemon", "device", "motion", "file"}


@dataclass(frozen=True, slots=True)
class FleetMotion:
    """The motion of one device.

    Attributes:
        daemon: its name in the cell.
        device: of that daemon; empty for the only one.
        request: the motion.
    """

    daemon: str
    device: str
    request: MotionRequest

    def __str__(self) -> str:
        return f"{self.daemon}/{self.device}" if self.device else self.daemon


def read_plan(path: Path) -> tuple[list[FleetMotion], float]:
    """Return the motions in a file, and the time from the end of planning to their start, s.

    Raises:
        RequestError: the file cannot be read or is not well formed.
    """
    content = read_structured(path)
    if not isinstance(content, Mapping) or not isinstance(content.get("motions"), list):
        raise RequestError("motions", "expected a list, each of daemon, device and motion")
    _check_keys("", content, {"motions", "start_in"})
    start_in = content.get("start_in", START_IN)
    if isinstance(start_in, bool) or not isinstance(start_in, int | float) or not start_in > 0:
        raise RequestError("start_in", f"expected seconds above 0, got {start_in!r}")
    motions = [
        _motion(f"motions[{number}]", one, path.parent)
        for number, one in enumerate(content["motions"])
    ]
    if not motions:
        raise RequestError("motions", "expected at least one, got none")
    names = [str(motion) for motion in motions]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RequestError("motions", f"expected each device once, got {twice} twice")
    return motions, float(start_in)


def _motion(place: str, content: object, folder: Path) -> FleetMotion:
    if not isinstance(content, Mapping):
        raise RequestError(place, f"expected daemon, device and motion, got {content!r}")
    _check_keys(f"{place}.", content, _KEYS)
    daemon, device = content.get("daemon"), content.get("device", "")
    if not isinstance(daemon, str) or not daemon or "/" in daemon or "*" in daemon:
        raise RequestError(f"{place}.daemon", f"expected the name of a daemon, got {daemon!r}")
    if not isinstance(device, str):
        raise RequestError(f"{place}.device", f"expected the name of a device, got {device!r}")
    if ("file" in content) == ("motion" in content):
        raise RequestError(f"{place}.motion", "expected either a motion here or a file")
    try:
        if "file" in content:
            return FleetMotion(daemon, device, motion_file.load(folder / str(content["file"])))
        return FleetMotion(daemon, device, motion_file.parse(content["motion"]))
    except RequestError as error:
        field = f"{place}.motion.{error.field}" if error.field else f"{place}.motion"
        raise RequestError(field, error.problem) from error


def _check_keys(place: str, content: Mapping[object, object], known: set[str]) -> None:
    for key in content:
        if key not in known:
            expected = ", ".join(sorted(known))
            raise RequestError(f"{place}{key}", f"expected one of {expected}")
