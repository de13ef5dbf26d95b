"""Targets that an arm's joints cannot follow end in no protective stop of the emulated robot."""

import time
from math import inf

import pytest
from ur_rig import begin_to_track, device_of, is_holding, until

from orientd.driver import ZERO
from orientd.errors import Fault, RequestError
from orientd.floats import difference, exp, multiply, norm
from orientd.stream.records import ServoState

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


def followed(device, at, seconds, *, position=None, tolerance=inf):
    """Stream targets at 50 Hz, then stop; return what was refused."""
    refused = set()
    begin_to_track(device, tolerance)
    begin = time.monotonic()
    while (t := time.monotonic() - begin) < seconds:
        now = time.monotonic_ns()
        try:
            device.targets.aim(at(t), None, now, now + 300_000_000, position)
        except RequestError as error:
            refused.add(error.problem)
        time.sleep(0.02)
        snapshot = device.snapshot()
        assert snapshot.state is ServoState.TRACKING, (snapshot.fault, snapshot.fault_text)
    device.stop()
    until(lambda: is_holding(device), lambda: f"holding {device.snapshot()}")
    assert device.snapshot().fault is Fault.NONE
    return refused


def test_targets_beyond_the_end_of_a_joint_are_refused_and_the_arm_stops_before_it(ur_robot):
    with device_of(ur_robot.host) as device:
        q = device.snapshot().cycle.q
        begin_to_track(device)
        for k in range(1, 20):
            goal = multiply(q, exp((0.0, 0.0, 0.4 * k)))

            def is_there(goal=goal):
                now = time.monotonic_ns()
                device.targets.aim(goal, ZERO, now, now + 300_000_000)
                return norm(difference(device.snapshot().cycle.q, goal)) < 0.01

            try:
                until(is_there, lambda: f"there: {device.snapshot()}")
            except RequestError as error:
                refusal = error.problem
                break
        device.stop()
        until(lambda: is_holding(device), lambda: f"holding {device.snapshot()}")
        assert refusal.startswith("wrist 3 would have to turn to 6.4")
        assert 5.9 < ur_robot.state()["target_q"][5] < 6.28
        assert ur_robot.state()["safety_mode"] == "NORMAL"


def test_positions_out_of_reach_are_refused_by_name(ur_robot):
    with device_of(ur_robot.host) as device:
        q = device.snapshot().cycle.q
        refused = followed(device, lambda _: q, 0.5, position=(1000.0, 0.0, 0.0))
        assert refused == {"the device does not reach there"}


def test_an_arm_stops_before_it_leaves_its_straight_line_farther_than_it_may(ur_robot):
    largest = []
    for tolerance in (inf, 2e-3):
        with device_of(ur_robot.host) as device:
            cycle = device.snapshot().cycle
            goal = multiply(cycle.q, exp((0.0, 0.9 if tolerance == inf else -0.9, 0.0)))
            counts = device.targets.count()
            refused = followed(
                device, lambda _, q=goal: q, 3.0, position=cycle.position, tolerance=tolerance
            )
            away = norm(difference(device.snapshot().cycle.q, goal))
            largest.append(counts.path_deviations[1])
            assert (refused, away < 0.01) == (set(), tolerance == inf)
    assert largest[0] > 3e-3
    assert 1.6e-3 < largest[1] < 2.02e-3
    assert ur_robot.state()["safety_mode"] == "NORMAL"
