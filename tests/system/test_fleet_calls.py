"""Calls with many requests reach a daemon of a cell as they do at its control socket."""

import json
import subprocess

import grpc
import numpy as np
import pytest
from command_line import begin, environment
from fleet_cell import CELL, RunningCell
from harness import until

from orientd import rotation
from orientd.errors import RequestError
from orientd.rotation import Quaternion
from orientd.rpc import Outcome
from orientd.rpc import control_pb2 as pb
from orientd.rpc.control_pb2_grpc import ControlStub
from orientd.stream import ServoState

pytest.importorskip("zenoh")

AIM = Quaternion(w=float(np.cos(0.15)), x=0.0, y=0.0, z=float(np.sin(0.15)))
MANY = [{"rotation_vector": [0.0, 0.0, 0.2 * np.sin(0.01 * k)]} for k in range(200)]


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    folder.chmod(0o700)
    with RunningCell(folder, 1) as cell:
        yield cell


@pytest.fixture
def fleet(cell):
    with cell.fleet() as fleet:
        yield fleet


def cycle(robot):
    (device,) = robot.state().devices.values()
    return device.cycle


def test_a_device_follows_targets_and_comes_to_rest_at_their_end(fleet):
    with fleet.robot("arm-1") as robot:
        with robot.track() as tracking:

            def is_there():
                tracking.aim(AIM)
                return tracking.report.error is not None and tracking.report.error < 1e-3

            until(is_there, "it is there")
        assert (
            rotation.angle(np.array(cycle(robot).q), np.array([AIM.w, AIM.x, AIM.y, AIM.z])) < 1e-3
        )
        assert cycle(robot).state is ServoState.HOLDING
        assert tracking.report.refused == 0


def test_no_target_is_left_out_however_fast_they_come(fleet):
    with fleet.robot("arm-1") as robot:
        with robot.track() as tracking:
            for _ in range(500):
                tracking.aim(AIM)
            until(lambda: tracking.report.targets >= 500, "all of them")
        assert tracking.report.targets == 500


def test_whoever_follows_stops_when_the_caller_has_gone(cell, fleet):
    with cell.fleet() as other:
        tracking = other.robot("arm-1").track()
        tracking.aim(AIM)
    with fleet.robot("arm-1") as robot:
        until(lambda: cycle(robot).state is ServoState.HOLDING, "it holds")
        until(lambda: not robot.state().daemon.leases, "the lease runs out")


def test_a_refusal_is_told_in_the_same_words(fleet):
    with fleet.robot("arm-1") as robot, pytest.raises(RequestError, match="limits"):
        robot.track(limits={"velocity": -1.0})


def test_a_motion_of_many_keyframes_is_planned_and_run(fleet):
    with fleet.robot("arm-1") as robot:
        plan = robot.plan(MANY, approach=True, limits={"velocity": 2.0})
        assert len(plan.keyframe_times) == len(MANY)
        move = robot.move(MANY, approach=True)
        until(lambda: cycle(robot).state is ServoState.STREAMING, "it moves")
        move.cancel()
        assert move.wait(20.0).outcome is Outcome.STOPPED


def test_a_message_too_large_is_refused_and_ends_the_call(fleet):
    motion = pb.MotionRequest(columns=pb.KeyframeColumns(times=[0.0] * 1_200_000))
    with fleet.channel("arm-1") as channel, pytest.raises(grpc.RpcError) as caught:
        ControlStub(channel).Plan(pb.PlanRequest(motion=motion))
    assert caught.value.code() is grpc.StatusCode.RESOURCE_EXHAUSTED


def test_the_command_follows_at_the_address_of_a_fleet(cell):
    variables = environment(ORIENTD_FLEET=cell.endpoint, ORIENTD_CELL=CELL)
    targets = f"{json.dumps({'rotation_vector': [0, 0, 0.1], 'time_to_live': 5.0})}\n" * 20
    process = begin(
        "track", "--address", "fleet:arm-1", "--json", env=variables, stdin=subprocess.PIPE
    )
    output, errors = process.communicate(targets, timeout=30.0)
    assert (process.returncode, errors) == (0, "")
    assert json.loads(output)["targets"] == 20
