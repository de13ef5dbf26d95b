"""The controller of diffusion_policy and UMI, with a real daemon behind it."""

import math
import time

import numpy as np
import pytest
from harness import until

import orientd
from orientd.errors import RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd_diffusion_policy import RTDEInterpolationController
from orientd_diffusion_policy.interpolation_controller import KEYS

pytestmark = pytest.mark.world

A, B = [1.4108558893203735, -0.14490126, 2.29686666], [-1.98694757, -0.20934335, -2.12741767]
"""Rotation vectors of a policy that are 46.66 degrees apart; their components change sign."""


@pytest.fixture
def controller(daemon):
    with orientd.connect(daemon.socket) as robot:
        robot.move([{"rotation_vector": A, "position": [0, 0, 0]}], approach=True).wait(30.0)
    with RTDEInterpolationController(
        None,
        "192.0.2.1",
        frequency=125,
        max_pos_speed=0.25,
        gain=300,
        receive_latency=0.25,
        socket=daemon.socket,
    ) as controller:
        yield controller


def pose(controller):
    return controller.get_state()["TargetTCPPose"]


def test_waypoints_are_passed_at_their_times_and_the_last_one_is_kept(daemon, controller):
    before = len(daemon.sent())
    begin = time.time() + 0.1
    for k in range(20):
        controller.schedule_waypoint([0.005 * k, 0.0, 0.0, *A], begin + k / 20)
    until(lambda: pose(controller)[0] == pytest.approx(0.095, abs=1e-6), "the last waypoint")
    x = [state[0] for state in controller.get_all_state()["TargetTCPPose"]]
    assert max(x) < 0.096
    daemon.assert_limits_kept(max(0, before - 3))


def test_a_later_waypoint_is_dropped_for_one_before_it(controller):
    now = time.time()
    controller.schedule_waypoint([0.2, 0.0, 0.0, *A], now + 9.0)
    controller.schedule_waypoint([0.0, 0.02, 0.0, *A], now + 0.5)
    until(lambda: pose(controller)[1] == pytest.approx(0.02, abs=1e-4), "the waypoint")
    assert pose(controller)[0] == pytest.approx(0.0, abs=1e-3)


def test_a_twin_of_a_rotation_vector_is_the_short_way(daemon, controller):
    before = len(daemon.sent())
    here = pose(controller)[:3]
    controller.servoL([*here, *A], duration=0.1)
    controller.servoL([*here, *B], duration=1.5)
    goal = orientd.rotation.exp(B)
    until(lambda: orientd.rotation.angle(daemon.sent()[-1], goal) < 1e-4, "the pose")
    sent = daemon.sent()[before:]
    way = orientd.rotation.angle(sent[1:], sent[:-1]).sum()
    assert np.degrees(way) == pytest.approx(46.66, abs=1.0)


def test_states_have_the_names_and_shapes_of_the_original(controller):
    until(lambda: len(controller.get_all_state()["ActualQ"]) > 20, "states")
    one, some = controller.get_state(), controller.get_state(k=5)
    for name, width in KEYS.items():
        assert one[name].shape == (width,)
        assert some[name].shape == (5, width)
    assert one["robot_timestamp"] == one["robot_receive_timestamp"] - 0.25
    stamps = controller.get_all_state()["robot_receive_timestamp"]
    assert abs(stamps[-1] - time.time()) < 5.0
    assert np.diff(stamps).mean() == pytest.approx(1 / 125, rel=0.3)
    assert one["ActualTCPPose"] == pytest.approx(one["TargetTCPPose"], abs=1e-2)


def test_it_is_ready_once_started_and_refuses_poses_of_another_shape(daemon, controller):
    assert controller.is_ready
    with pytest.raises(ValueError, match=r"\(6,\)"):
        controller.servoL([0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="positive"):
        controller.servoL([0.0] * 6, duration=0.0)
    idle = RTDEInterpolationController(socket=daemon.socket, device="no such")
    with pytest.raises(StateError, match="not started"):
        idle.servoL([0.0] * 6)
    with pytest.raises(StateError, match="no such"):
        idle.start()
    idle.stop()


@pytest.mark.parametrize("speed", [0.0, 1e-12])
def test_a_start_that_is_refused_keeps_no_lease(daemon, speed):
    refused = RTDEInterpolationController(socket=daemon.socket, max_pos_speed=speed)
    with pytest.raises(RequestError, match="linear_velocity"):
        refused.start()
    assert not daemon.stub.GetState(pb.GetStateRequest()).daemon.leases


def test_what_is_asked_for_wrongly_or_too_early_is_an_error_of_its_own(daemon):
    for wrong in (0, math.nan, "fast"):
        with pytest.raises(RequestError, match=f"frequency: expected more than 0, got {wrong!r}"):
            RTDEInterpolationController(frequency=wrong)
    idle = RTDEInterpolationController(socket=daemon.socket)
    for ask in (idle.get_state, idle.get_all_state):
        with pytest.raises(StateError, match="no state yet"):
            ask()
