"""How many functions and types ``orientd move`` passes from the shell to its first path record.

The mathematics of planning is left out: the rooms ``rotation``, ``kernels``, ``curves``,
``mechanism`` and ``planner``, and drivers.  So is what the daemon does all the time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness import DaemonProcess

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.bench

MOST_FUNCTIONS = 220
MOST_TYPES = 42
"""They may only shrink: 80 functions and 25 types are as many as a reader can follow."""

FIRST_RECORD = "orientd/stream/ring.py:RecordRing.put"
_ROOMS = ("rotation", "kernels", "curves", "mechanism", "planner")
LEFT_OUT = (*(f"orientd/{room}/" for room in _ROOMS), "drivers/", "sim/")
MOVES = 6
"""What all of them pass is on the way.  Other threads do something else at the same time."""

QUIET = 3.0
"""How long the daemon is watched doing nothing, s: longer than the period of anything it does."""

MOTION = """\
approach: true
keyframes:
  - time: 0.0
    quaternion: {w: 1.0, x: 0.0, y: 0.0, z: 0.0}
  - time: 1.0
    quaternion: {w: 0.9689124217106447, x: 0.0, y: 0.0, z: 0.24740395925452294}
"""


def run(command: list[str], environment: dict[str, str]) -> None:
    """Run a command that must succeed."""
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def calls_of(folder: Path) -> list[tuple[int, str, str]]:
    """Return time, function and type of the calls of every process, in their order."""
    lines = [line for path in folder.iterdir() for line in path.read_text().splitlines()]
    split = [line.split(" ") for line in lines]
    return sorted((int(when), name, owner) for when, name, owner in split)


def way_of_a_move(tmp_path: Path) -> tuple[set[str], set[str]]:
    """Return the functions and the types that one move passes."""
    noted = tmp_path / "noted"
    noted.mkdir()
    here = str(Path(__file__).with_name("way"))
    traced = {"PYTHONPATH": here, "ORIENTD_WAY": str(noted)}
    motion = tmp_path / "turn.yaml"
    motion.write_text(MOTION)
    daemon = DaemonProcess(tmp_path / "daemon")
    daemon.environment = traced
    with daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        command = [
            sys.executable, "-m", "orientd", "move", str(motion), "--socket", str(daemon.socket),
        ]  # fmt: skip
        environment = {**os.environ, **traced}
        # The first one loads what later ones find loaded.
        run(command, environment)
        time.sleep(QUIET)
        quiet_ns = time.monotonic_ns()
        time.sleep(QUIET)
        begun = []
        for _ in range(MOVES):
            begun.append(time.monotonic_ns())
            run(command, environment)
    calls = calls_of(noted)
    idle = {name for when, name, _ in calls if quiet_ns < when < begun[0]}
    passed = [passed_from(begun_ns, calls) for begun_ns in begun]
    names = set.intersection(*[{name for name, _ in one} for one in passed]) - idle
    owners = {owner for one in passed for name, owner in one if name in names and owner}
    return names, owners


def passed_from(begun_ns: int, calls: list[tuple[int, str, str]]) -> set[tuple[str, str]]:
    """Return functions and types from the beginning of a move to its first record."""
    first = next(when for when, name, _ in calls if when > begun_ns and name == FIRST_RECORD)
    return {
        (name, owner)
        for when, name, owner in calls
        if begun_ns < when <= first and not name.startswith(LEFT_OUT)
    }


def test_a_move_passes_few_functions_and_types(tmp_path):
    functions, types = way_of_a_move(tmp_path)
    assert len(functions) <= MOST_FUNCTIONS, "\n".join(sorted(functions))
    assert len(types) <= MOST_TYPES, "\n".join(sorted(types))
