"""Modules that the daemon's own process has loaded after motions."""

from pathlib import Path

import pytest
from storm_rig import Rig

import orientd
from orientd.errors import PlanError, RequestError
from orientd.protocol import control_pb2 as pb

HEAVY = ("/numpy/", "/numpy.libs/", "/scipy/", "/scipy.libs/", "native.abi3")
"""What is for processes that plan alone: libraries by their paths."""

MOTION = [{"rotation_vector": [angle, 0.0, angle * angle]} for angle in (0.0, 0.1, 0.2)]
SLOW = {"velocity": 0.1}

REFUSED = (
    {"duration": 1e-3},
    {"limits": {"velocity": 1e-3, "acceleration": 1e-6, "jerk": 1e-9}},
    {"end_velocity": [100.0, 0.0, 0.0]},
    {"method": "c2_cumulatve"},
)


def test_the_daemon_loads_nothing_that_only_planning_needs(tmp_path):
    with Rig(tmp_path, devices=["arm"]) as rig, orientd.connect(rig.socket) as robot:
        for method in ("c2_cumulative", "minimum_effort", "squad"):
            motion = robot.move(MOTION, method=method, approach=True)
            assert motion.wait(60.0).outcome == pb.OUTCOME_DONE
        for wrong in REFUSED:
            with pytest.raises((PlanError, RequestError)):
                robot.plan(MOTION, **wrong)
        robot.move([{"rotation_vector": [0.5, 0.0, 0.0]}], approach=True, limits=SLOW)
        for wrong in REFUSED:
            with pytest.raises((PlanError, RequestError)):
                robot.move(MOTION, approach=True, **wrong)
        robot.move([{"rotation_vector": [0.2, 0.3, 0.0]}], approach=True)
        following = [{"rotation_vector": [0.2, 0.3, 0.0]}, *MOTION[:1]]
        robot.move(following, queue=True, blend_tolerance=0.05).wait(20.0)
        maps = Path(f"/proc/{rig.pid}/maps").read_text().splitlines()
    libraries = {line.split()[-1] for line in maps if ".so" in line}
    assert not {path for path in libraries if any(part in path for part in HEAVY)}
