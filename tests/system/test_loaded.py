"""Modules that the daemon's own process has loaded after motions."""

from pathlib import Path

from storm_rig import Rig

import orientd
from orientd.protocol import control_pb2 as pb

HEAVY = ("/scipy/", "/scipy.libs/", "native.abi3")
"""What is for processes that plan alone: libraries by their paths."""

MOTION = [{"rotation_vector": [angle, 0.0, angle * angle]} for angle in (0.0, 0.1, 0.2)]


def test_the_daemon_loads_nothing_that_only_planning_needs(tmp_path):
    with Rig(tmp_path, devices=["arm"]) as rig, orientd.connect(rig.socket) as robot:
        for method in ("c2_cumulative", "minimum_effort", "squad"):
            motion = robot.move(MOTION, method=method, approach=True)
            assert motion.wait(60.0).outcome == pb.OUTCOME_DONE
        maps = Path(f"/proc/{rig.pid}/maps").read_text().splitlines()
    libraries = {line.split()[-1] for line in maps if ".so" in line}
    assert not {path for path in libraries if any(part in path for part in HEAVY)}
