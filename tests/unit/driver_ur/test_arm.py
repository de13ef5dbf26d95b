"""The arm as a mechanism: its kinematics, and what the planner makes of a path with it."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from orientd.errors import LimitError, PlanError
from orientd.floats import exp, log, multiply
from orientd.mechanism.routing import check_way, joints_along
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import rotate
from orientd_ur import UrDriver
from orientd_ur.arm import MODELS

UR5E = MODELS["ur5e"].arm()
forward, inverse = UR5E.kinematics.forward, UR5E.kinematics.inverse


def reserve(joints):
    return {one.name: one.value for one in UR5E.reserve(joints)}


HOME = (0.0, -math.pi / 2, 1.4, -1.4, -math.pi / 2, 0.0)


def furthest(a, b):
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def flat(pose):
    q, position = pose
    return [*exp(log(q)), *position]


pose_at = forward


@pytest.mark.parametrize("bend", [0.0, 5e-8, 2e-7, 1e-5])
def test_straight_wrist_is_solved_on_both_sides_of_its_seam(bend):
    q = (0.3, -1.2, 1.5, -1.9, bend, 0.4)
    found = inverse(forward(q), q)
    assert furthest(flat(forward(found)), flat(forward(q))) < 1e-6


def test_out_of_reach_is_none():
    assert inverse(((1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), HOME) is None


def test_path_is_followed_without_a_jump_through_a_turn_beyond_pi():
    path = [(*HOME[:5], 0.02 * k) for k in range(250)]
    assert furthest(along(path)[-1], path[-1]) < 1e-9


def test_tool_is_carried_by_the_flange():
    turn, offset = exp((0.3, -0.2, 0.1)), (0.01, -0.02, 0.1)
    arm = replace(UR5E, tool=(turn, offset))
    q, p = pose_at(HOME)
    found, position = arm.forward(HOME)
    assert position == pytest.approx(np.add(p, rotate(q, offset)), abs=1e-15)
    assert found == pytest.approx(multiply(q, turn), abs=1e-15)
    assert arm.nearest(found, position, HOME) == pytest.approx(HOME, abs=1e-12)
    again_turn, again_offset = UR5E.seen(HOME, (found, position)).tool
    assert (again_turn, again_offset) == (pytest.approx(turn), pytest.approx(offset))


def test_every_branch_is_a_solution_and_the_nearest_is_among_them():
    generator, most = random.Random(8), 0
    for _ in range(50):
        joints = tuple(generator.uniform(-math.pi, math.pi) for _ in range(6))
        if min(reserve(joints).values()) < 0.05:
            continue
        found = UR5E.solutions(*UR5E.forward(joints))
        for one in found:
            assert furthest(flat(forward(one)), flat(forward(joints))) < 1e-9
        # Some are out of reach where others are not; whole turns are left aside.
        near = [
            np.add(one, math.tau * np.round(np.subtract(joints, one) / math.tau)) for one in found
        ]
        assert min(furthest(one, joints) for one in near) < 1e-9
        assert len({tuple(round(angle, 6) for angle in one) for one in near}) == len(near)
        most = max(most, len(found))
    assert most == 8


def along(rows):
    """Return the path of the arm whose flange goes where *rows* of joints, 8 ms apart, bring it."""
    poses = [forward(row) for row in rows]
    q, position = np.array([q for q, _ in poses]), np.array([p for _, p in poses])
    return followed(q, position, tuple(rows[0]))


def followed(q, position, near):
    """Return the joints of the arm along poses, 8 ms apart."""
    times = 0.008 * np.arange(len(q))
    joints = joints_along(UR5E, times, q, position, near)
    check_way(UR5E, joints, times)
    return joints


def wrist_turn(rate, begin=0.0):
    return [(*HOME[:5], begin + rate * 0.008 * k) for k in range(125)]


def test_slow_turn_is_accepted_with_its_joint_speed():
    speeds = np.abs(np.diff(along(wrist_turn(2.0)), axis=0)) / 0.008
    assert speeds[:, 5] == pytest.approx(2.0)
    assert speeds[:, 0].max() < 1e-9


@pytest.mark.parametrize(("begin", "rate"), [(5.8, 1.0), (-5.8, -1.0)])
def test_joint_that_winds_up_is_refused_by_name_and_time(begin, rate):
    along(wrist_turn(rate, begin)[:60])
    with pytest.raises(LimitError, match=r"angle of wrist 3 .* at 0\.488") as caught:
        along(wrist_turn(rate, begin))
    assert "turn less far (a turn by a shorter `--duration`), or unwind it first" in str(
        caught.value
    )


def test_path_near_a_straight_wrist_is_refused_with_the_time():
    with pytest.raises(PlanError, match=r"wrist comes within .* at (0\.9|1\.0)"):
        along([(*HOME[:4], -0.5 + 0.004 * k, 0.0) for k in range(250)])


def test_path_out_of_reach_is_refused_with_the_time():
    q, (x, y, z) = pose_at(HOME)
    position = np.array([(x - 0.004 * k, y, z) for k in range(250)])
    with pytest.raises(PlanError, match=r"at \d\.\d+ s|elbow"):
        followed(np.array([q] * 250), position, HOME)


def test_motion_runs_slower_where_a_joint_needs_it():
    limits = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)
    begin = (0.3, -1.3, 1.5, -1.7, -0.12, 0.4)

    def plan(**options):
        settings = {"host": "127.0.0.9", "model": "ur5e", **options}
        driver = UrDriver(settings, period_ns=2_000_000, clock=ManualClock(1))
        q, position = driver.mechanism(may_ask=False).forward(begin)
        goal = multiply(q, exp((0.1, 0.5, 0.1)))
        request = MotionRequest([Keyframe(goal, position=position)], approach=True)
        planner = DevicePlanner(driver, limits=limits, period=0.002)
        start = State.at_rest(q, position)
        return planner.plan(request, start=start, joints=begin, is_offline=True)

    free, bound = plan(), plan(joint_acceleration_deg=300.0)
    assert bound.duration > 1.2 * free.duration
    figures = {figure.name: figure for figure in bound.certificate.figures}
    forces = [one for name, one in figures.items() if name.startswith("acceleration of")]
    speeds = [one for name, one in figures.items() if name.startswith("velocity of")]
    assert max(one.value / one.limit for one in forces + speeds) > 0.85
    assert figures["acceleration of wrist 3"].limit == pytest.approx(math.radians(300.0))
    for figure in bound.certificate.figures:
        assert (
            figure.limit is None or "angle" in figure.name or figure.value <= 1.001 * figure.limit
        )
    moved = np.abs(np.diff(bound.path.joints, 2, axis=0)) / 0.002**2
    assert 0.5 * math.radians(300.0) < np.max(moved) <= 1.001 * math.radians(300.0)


def test_reserves_are_the_bends_and_the_distance_from_the_cylinder_about_the_base():
    generator = random.Random(6)
    for _ in range(50):
        joints = tuple(generator.uniform(-3.0, 3.0) for _ in range(6))
        x, y, _ = UR5E.kinematics.frames(joints)[5]
        found = reserve(joints)
        assert found["wrist"] == pytest.approx(abs(math.sin(joints[4])))
        assert found["elbow"] == pytest.approx(abs(math.sin(joints[2])))
        # The fifth frame is off the plane of shoulder and elbow by d4.
        assert math.hypot(found["shoulder"], 0.1333) == pytest.approx(math.hypot(x, y))
