"""Targets that are followed ask no more of an arm's joints than they can do, in any cycle."""

import os
import random
import re
import tomllib
from dataclasses import replace
from itertools import pairwise
from math import dist, pi, tau
from pathlib import Path

import numpy as np
import pytest
from arm_rig import ArmRig, joints_of
from rig import PERIOD, turn

from orientd.floats import difference, exp, multiply, norm, rotate
from orientd.keep_out import KeepOut
from orientd.mechanism.mechanism import refusal
from orientd.stream.records import (
    DEVIATION_WORD,
    LARGEST_DEVIATION_WORD,
    Answer,
    Command,
    ServoState,
)
from orientd.tolerances import GUARD_TOLERANCE
from orientd_ur.arm import MODELS

CASES = int(os.environ.get("ORIENTD_CASES", "2"))
HOME = (0.0, -pi / 2, pi / 2, -pi / 2, -pi / 2, 0.0)
SECOND = 10**9


def turning(q, axis, rate, most):
    """Return where a tool that turns about its own *axis* is after a time, and rests at *most*."""

    def at(t):
        turn = min(rate * t, most)
        return multiply(q, exp(tuple(turn * x for x in axis)))

    return at


def bent(rig, radians):
    """Return the pose of the tool with wrist 2 turned by *radians* from HOME."""
    joints = (*HOME[:4], HOME[4] + radians, HOME[5])
    return rig.arm.forward(joints)


def straighten(rig, way=1.0, most=2.2):
    """Turn wrist 2 past its singularity, not quite straight."""
    aside = exp((0.02, 0.01, 0.0))
    rig.follow(
        lambda t: multiply(bent(rig, way * min(0.6 * t, most))[0], aside),
        seconds=3.8,
        position=lambda t: bent(rig, way * min(0.6 * t, most))[1],
    )


def test_targets_are_followed_on_after_a_stall_of_the_servo():
    rig = ArmRig("ur5e", HOME)
    at = turning(rig.q, (0.0, 0.0, 1.0), 2.0, 0.4)
    rig.follow(at, seconds=0.15)
    assert norm(rig.servo.setpoints.last.omega_body) > 0.5
    rig.clock.advance(60_000_000)
    rig.follow(lambda _: at(1.0), seconds=2.0)
    assert not rig.hindrances
    assert norm(difference(rig.servo.setpoints.last.q, at(1.0))) < 1e-3
    assert rig.servo.state is ServoState.TRACKING


def test_an_arm_without_a_target_stays_at_rest_after_a_stall_of_the_servo():
    rig = ArmRig("ur5e", HOME)
    far = turning(rig.q, (0.0, 0.0, 1.0), 1.4, 2.5)(9.0)
    rig.follow(lambda _: far, seconds=0.5)
    assert norm(rig.servo.setpoints.last.omega_body) > 0.5
    rig.clock.advance(400_000_000)  # the last target expires after 0.3 s
    rig.run(300)
    assert rig.servo.state is ServoState.TRACKING
    assert len({s.q for s in rig.setpoints[-300:]}) == 1


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_wrist_that_is_to_pass_its_singularity_is_held_before_it(way):
    rig = ArmRig("ur5e", HOME)
    straighten(rig, way)
    assert rig.servo.state is ServoState.TRACKING
    assert rig.hindrances
    said = rig.notices()
    assert 1 <= len(said) <= 3  # once for each time, not in every cycle
    for text in said:
        assert text.startswith("targets are followed more slowly, or not to their end: ")
    rig.check()


def test_a_tool_that_is_held_goes_on_when_the_target_comes_back():
    rig = ArmRig("ur5e", HOME)
    straighten(rig)
    assert rig.hindrances
    q, position = bent(rig, 0.3)
    rig.follow(lambda _: q, seconds=3.0, position=lambda _: position)
    assert norm(difference(rig.setpoints[-1].q, q)) < 1e-4
    assert not rig.servo.setpoints.pursuit.hindrance
    rig.check()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_joint_stops_before_the_end_of_its_range(way):
    rig = ArmRig("ur5e", (*HOME[:5], way * 5.9))
    rig.follow(turning(rig.q, (0.0, 0.0, way), 0.4, 2.0), seconds=5.0)
    joints = rig.check()
    assert 0.01 < tau - np.abs(joints[:, 5]).max() < 0.05
    assert any("wrist 3" in text for text in rig.hindrances)


def test_a_position_that_is_out_of_reach_is_not_followed_to_the_end():
    rig = ArmRig("ur5e", HOME)
    far = tuple(3.0 * x for x in rig.position)
    rig.follow(lambda _: rig.q, seconds=5.0, position=lambda _: far)
    rig.check()
    assert rig.hindrances


def test_targets_that_the_joints_can_follow_are_followed_as_if_there_were_none():
    """Without lag, and as closely as by a device of poses with the same limits."""
    apart = []
    for has_axes in (True, False):
        rig = ArmRig("ur5e", HOME, has_axes=has_axes)
        begin = rig.clock.now_ns()

        def at(t, q=rig.q):
            return multiply(q, exp((0.2 * np.sin(t), 0.0, 0.3 * t)))

        rig.follow(at, 3.0)
        assert not rig.hindrances
        late = [s for s in rig.setpoints if s.time_ns > begin + 1.5 * SECOND]
        gaps = [norm(difference(s.q, at((s.time_ns - begin) * 1e-9))) for s in late]
        apart.append(max(gaps))
    assert max(apart) < 1e-3
    assert apart[0] < apart[1] + 2e-4


@pytest.mark.parametrize("hardest", [40.0, 20.0, 8.0])
def test_a_turn_is_made_as_soon_as_the_joints_permit_and_no_limit_is_exceeded(hardest):
    """Joints that are slow make it longer, but never keep the arm from its target."""
    rng, limits = random.Random(7), {"velocity": 2.5, "acceleration": 17.0, "jerk": 8500.0}
    for _ in range(3):
        joints = tuple(x + rng.uniform(-0.5, 0.5) for x in HOME)
        rig = ArmRig("ur5e", joints, hardest=hardest, linear_velocity=1.0,
                     linear_acceleration=10.0, **limits)  # fmt: skip
        axis = [rng.gauss(0.0, 1.0) for _ in range(3)]
        target = multiply(rig.q, exp(tuple(0.5 * x / np.linalg.norm(axis) for x in axis)))
        goal = rig.arm.nearest(target, rig.position, joints)
        # Each joint alone, from rest to rest, and the tool alone.
        least = [2.0 * np.sqrt(abs(a - b) / hardest) for a, b in zip(goal, joints, strict=True)]
        seconds = 1.2 * max(*least, 2.0 * np.sqrt(0.5 / 17.0))
        rig.follow(lambda _, q=target: q, seconds)
        assert norm(difference(rig.setpoints[-1].q, target)) < 1e-3
        assert dist(rig.setpoints[-1].position, rig.position) < 1e-3
        rig.check()


def test_a_position_is_reached_with_linear_limits_that_the_joints_cannot_keep():
    rig = ArmRig("ur5e", HOME, hardest=20.0, linear_velocity=1.0, linear_acceleration=20.0)
    x, y, z = rig.position
    rig.follow(lambda _: rig.q, 2.3, position=lambda t: (x, y, z + min(0.1 * t, 0.2)))
    assert dist(rig.setpoints[-1].position, (x, y, z + 0.2)) < 1e-3
    assert not rig.hindrances
    rig.check()


def test_components_of_the_turn_keep_their_own_limits():
    slow, hard = (1.5, 0.4, 1.5), (8.0, 1.0, 8.0)
    rig = ArmRig("ur5e", HOME, axis_velocity=slow, axis_acceleration=hard)
    at = turning(rig.q, (0.6, 0.8, 0.0), 9.0, 0.8)
    rig.follow(at, 4.0)
    assert norm(difference(rig.setpoints[-1].q, at(1.0))) < 1e-3
    poses = [s.q for s in rig.setpoints]
    rig.check()
    omega = np.array([difference(a, b) for a, b in pairwise(poses)]) / PERIOD
    assert np.abs(omega[:, 1]).max() <= 0.4 * GUARD_TOLERANCE
    assert np.abs(omega[:, 1]).max() > 0.3
    assert np.abs(np.diff(omega[:, 1])).max() / PERIOD <= 1.0 * GUARD_TOLERANCE


def test_lower_limits_hold_as_soon_as_a_stop_keeps_them():
    rig = ArmRig("ur5e", HOME)
    rig.follow(turning(rig.q, (0.0, 0.0, 1.0), 1.4, 3.0), 0.6)
    assert norm(rig.servo.setpoints.last.omega_body) > 1.0
    slower = replace(rig.limits, velocity=0.5, acceleration=4.0)
    assert rig.ask(Command.TRACK, motion=2, servo_limits=slower)[0] is Answer.DONE
    sent = len(rig.setpoints)
    rig.follow(turning(rig.q, (0.0, 0.0, 1.0), 0.4, 3.0), 2.0)
    assert rig.servo.state is ServoState.TRACKING
    speeds = np.array([norm(s.omega_body) for s in rig.setpoints[sent:]])
    assert (np.diff(speeds[: np.argmax(speeds <= 0.5)]) < 0.02).all()
    assert speeds[np.argmax(speeds <= 0.5) :].max() <= 0.5 * GUARD_TOLERANCE
    assert np.argmax(speeds <= 0.5) * PERIOD < 0.4
    rig.check()


@pytest.mark.parametrize("cycles", [150, 400, 700])
def test_targets_take_over_from_a_path_in_motion_inside_every_limit(cycles):
    rig = ArmRig("ur5e", HOME, tracks=False)
    q, *rates = turn(1.2, 2.0, (0.0, 0.6, 0.8))
    path, still = [multiply(rig.q, tuple(one)) for one in q.tolist()], [rig.position] * len(q)
    first = rig.lay(np.array(path), *rates, position=still)
    assert rig.ask(Command.START, path_index=first, servo_limits=rig.limits)[0] is Answer.DONE
    rig.run(cycles)
    assert norm(rig.servo.setpoints.last.omega_body) > 0.1
    assert rig.ask(Command.TRACK, motion=2, servo_limits=rig.limits)[0] is Answer.DONE
    rig.follow(lambda _: rig.q, 2.0)
    assert norm(difference(rig.setpoints[-1].q, rig.q)) < 1e-3
    rig.check()


def test_what_the_arm_cannot_do_is_said_by_name():
    arm = MODELS["ur5e"].arm()
    q, (x, y, z) = arm.forward(HOME)
    assert refusal(arm, q, (x, y, z), HOME) == ""
    assert refusal(arm, q, (3 * x, 3 * y, 3 * z), HOME) == "the device does not reach there"
    assert refusal(arm, q, (1000.0, 0.0, 0.0), HOME) == "the device does not reach there"
    wound = (*HOME[:5], 6.2)
    beyond = multiply(multiply(q, exp((0.0, 0.0, 6.2))), exp((0.0, 0.0, 0.3)))
    assert "wrist 3 would have to turn to 6.5" in refusal(arm, beyond, (x, y, z), wound)
    straight = arm.forward((*HOME[:4], 0.0, 0.0))
    assert "the wrist is" in refusal(arm, *straight, (*HOME[:4], 0.1, 0.0))


def random_arm(rng):
    """Return a model and joints that are well away from every singularity."""
    model = rng.choice(sorted(MODELS))
    arm = MODELS[model].arm()
    while True:
        joints = tuple(rng.uniform(-pi, pi) for _ in range(6))
        if rng.random() < 0.2:
            joints = (*joints[:5], rng.choice([-1.0, 1.0]) * rng.uniform(5.0, 6.2))
        if all(one.value > 1.2 * one.least_followed for one in arm.reserve(joints)):
            return model, joints


@pytest.mark.parametrize("seed", range(CASES))
def test_random_streams_keep_every_limit_of_the_joints(seed):
    rng = random.Random(seed)
    model, joints = random_arm(rng)
    velocity = rng.uniform(0.3, 2.5)
    limits = {
        "velocity": velocity,
        "acceleration": rng.uniform(2.0, 15.0),
        "jerk": rng.uniform(50.0, 2000.0),
        "linear_velocity": rng.uniform(0.1, 1.0),
        "linear_acceleration": rng.uniform(0.5, 8.0),
    }
    rig = ArmRig(model, joints, **limits)
    start, centre = rig.q, rig.position
    axis = np.array([rng.gauss(0.0, 1.0) for _ in range(3)])
    axis /= np.linalg.norm(axis)
    away = np.array([rng.gauss(0.0, 1.0) for _ in range(3)])
    away *= rng.uniform(0.0, 1.0) / np.linalg.norm(away)
    rate, pace = rng.uniform(0.1, 1.2) * velocity, rng.uniform(0.2, 3.0)
    kind = rng.choice(["turn", "swing", "jumps", "still"])
    jumps = [exp(tuple(rng.gauss(0.0, 1.0) for _ in range(3))) for _ in range(20)]

    def at(t):
        if kind == "turn":
            return multiply(start, exp(tuple(rate * t * axis)))
        if kind == "swing":
            return multiply(start, exp(tuple(2.5 * np.sin(0.5 * rate * t) * axis)))
        return multiply(start, jumps[int(t / 0.7)]) if kind == "jumps" else start

    def place(t):
        return tuple(np.array(centre) + np.sin(pace * t) * away)

    moves = rng.random() < 0.6
    rig.follow(at, 3.0, hz=rng.choice([20, 50, 100]), position=place if moves else None)
    rig.check()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_arm_keeps_out_of_a_cone_inside_the_limits_of_its_joints(way):
    q = ArmRig("ur5e", HOME).q
    centre = rotate(turning(q, (0.0, 0.1, way), 0.6, 1.0)(1.0), (1.0, 0.0, 0.0))
    cone = KeepOut("window", centre, half_angle=0.2)
    rig = ArmRig("ur5e", HOME, cones=(cone,))
    rig.follow(turning(q, (0.0, 0.0, way), 0.5, 1.2), seconds=5.0)
    assert rig.servo.state is ServoState.TRACKING
    rig.check()
    assert min(cone.clearance(s.q, 0) for s in rig.setpoints) > 0.0
    assert cone.clearance(rig.setpoints[-1].q, 0) > 0.3


def test_an_arm_takes_no_step_beside_a_cone_whose_stop_would_enter_it():
    q, turn_to = ArmRig("ur5e", HOME).q, (0.0, 0.06, 0.6)
    centre = rotate(multiply(q, exp(tuple(0.6 * x for x in turn_to))), (1.0, 0.0, 0.0))
    cone = KeepOut("window", centre, half_angle=0.35)
    rig = ArmRig("ur5e", HOME, cones=(cone,), velocity=2.5, acceleration=17.0, jerk=8500.0,
                 linear_velocity=1.0, linear_acceleration=10.0)  # fmt: skip
    x, y, z = rig.position
    target, place = multiply(q, exp(turn_to)), (x, y - 0.15, z + 0.05)
    rig.follow(lambda _: target, seconds=1.0, position=lambda _: place)
    assert rig.servo.state is ServoState.TRACKING
    assert min(cone.clearance(s.q, 0) for s in rig.setpoints) > 0.0


@pytest.mark.parametrize(("way", "waits"), [(1.0, 0.0), (-1.0, 0.3)])
def test_an_arm_that_its_reach_holds_back_keeps_out_of_a_cone(way, waits):
    """Of a step that its joints cannot follow it takes a part, which must not lead inside."""
    q = ArmRig("ur5e", HOME).q
    at = turning(q, (0.0, 0.0, way), 0.5, 0.9)
    cone = KeepOut("window", rotate(at(9.0), (1.0, 0.0, 0.0)), half_angle=0.3)
    rig = ArmRig("ur5e", HOME, cones=(cone,))
    far = tuple(3.0 * x for x in rig.position)
    rig.follow(lambda t: at(max(0.0, t - waits)), seconds=waits + 3.0, position=lambda _: far)
    assert rig.servo.state is ServoState.TRACKING
    assert rig.hindrances
    rig.check()
    assert min(cone.clearance(s.q, 0) for s in rig.setpoints) > 0.0


@pytest.mark.parametrize("seed", [0, 1, 20])
def test_an_arm_that_begins_inside_a_cone_leaves_it_and_never_comes_nearer(seed):
    rng = random.Random(seed)
    q = ArmRig("ur5e", HOME).q
    aside = tuple(rng.uniform(-0.25, 0.25) for _ in range(3))
    centre = rotate(multiply(q, exp(aside)), (1.0, 0.0, 0.0))
    cone = KeepOut("window", centre, half_angle=0.4)
    assert cone.clearance(q, 0) < -0.05
    rig = ArmRig("ur5e", HOME, cones=(cone,))
    out = multiply(q, exp(tuple(rng.uniform(-1.2, 1.2) for _ in range(3))))
    x, y, z = rig.position
    place = (x, y - 0.1, z + 0.05)
    rig.follow(lambda _: out, seconds=1.0, position=lambda _: place)
    rig.follow(lambda _: q, seconds=0.6, position=lambda _: place)
    assert rig.servo.state is ServoState.TRACKING, rig.servo.setpoints.fault_text
    rig.check()
    found = [cone.clearance(s.q, 0) for s in rig.setpoints]
    assert all(after > min(before - 1e-9, -1e-9) for before, after in pairwise(found))
    assert found[-1] > found[0] + 0.01


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)])
def test_a_stop_after_a_refused_step_keeps_the_limits_of_the_joints(axis):
    rig = ArmRig("ur5e", HOME, hardest=8.0, velocity=2.5, acceleration=17.0, jerk=8500.0)
    rig.follow(turning(rig.q, axis, 2.0, 3.0), seconds=0.7)
    assert norm(rig.servo.setpoints.last.omega_body) > 0.5
    rig.servo.setpoints._guard.admit = lambda *_: "a limit of the test"
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.servo.state is ServoState.FAULT
    poses = [(s.q, s.position) for s in rig.setpoints]
    changes = np.diff(joints_of(rig.arm, poses, HOME), 2, axis=0) / PERIOD**2
    assert np.abs(changes).max() <= 8.0


def test_an_arm_whose_elbow_is_straight_follows_targets():
    """By rounding, its own kinematics may not reach the pose that its joints make."""
    rig = ArmRig("ur5e", (-0.755, -0.768, 0.0, -0.581, 1.2, -2.373))
    assert rig.arm.nearest(rig.q, rig.position, rig.start) is None
    place = tuple(0.8 * x for x in rig.position)
    rig.follow(lambda _: rig.q, seconds=4.0, position=lambda _: place)
    assert dist(rig.setpoints[-1].position, place) < 1e-4


def off_line(rig, places, goal):
    """Return the largest distance of *places* from the line from the start of *rig*, m."""
    along = np.subtract(goal, rig.position)
    square = max(along @ along, 1e-30)
    way = np.subtract(places, rig.position)
    share = np.clip(way @ along / square, 0.0, 1.0)
    return np.linalg.norm(way - share[:, None] * along, axis=1).max()


@pytest.mark.parametrize(("turned", "moved"), [(1.2, 0.0), (0.5, 0.0), (0.6, 0.15)])
def test_how_far_the_tool_leaves_its_straight_line_is_told(turned, moved):
    rig = ArmRig("ur5e", HOME, hardest=20.0)
    q = turning(rig.q, (0.0, 1.0, 0.0), 9.0, turned)(1.0)
    goal = tuple(np.add(rig.position, (0.0, 0.0, moved)).tolist())
    rig.follow(lambda _: q, seconds=3.0, position=lambda _: goal)
    assert dist(rig.setpoints[-1].position, goal) < 1e-4
    words = rig.memory.targets.words
    far = off_line(rig, [s.position for s in rig.setpoints], goal)
    assert words[LARGEST_DEVIATION_WORD] * 1e-9 == pytest.approx(far, rel=0.02)
    assert far > 1e-3
    assert words[DEVIATION_WORD] == 0
    assert rig.ask(Command.TRACK, servo_limits=rig.limits)[0] is Answer.DONE
    assert words[LARGEST_DEVIATION_WORD] == 0


def test_a_target_that_moves_within_the_limits_has_no_line_to_leave():
    rig = ArmRig("ur5e", HOME)
    rig.follow(turning(rig.q, (0.0, 0.0, 1.0), 0.3, 0.9), seconds=2.0)
    assert rig.memory.targets.words[LARGEST_DEVIATION_WORD] < 1e5


@pytest.mark.parametrize("tolerance", [1e-3, 4e-3])
def test_an_arm_stops_instead_of_leaving_its_straight_line_farther_than_it_may(tolerance):
    rig = ArmRig("ur5e", HOME, hardest=20.0, path_tolerance=tolerance)
    q = turning(rig.q, (0.0, 1.0, 0.0), 9.0, 1.2)(1.0)
    rig.follow(lambda _: q, seconds=3.0, position=lambda _: rig.position)
    far = off_line(rig, [s.position for s in rig.setpoints], rig.position)
    assert 0.8 * tolerance < far < 1.01 * tolerance
    assert norm(difference(rig.setpoints[-1].q, q)) > 0.1
    assert norm(rig.servo.setpoints.last.omega_body) < 1e-3
    assert rig.servo.state is ServoState.TRACKING
    text = f"the path_tolerance is {1e3 * tolerance:g} mm"
    assert any("leave the straight line by" in one and text in one for one in rig.hindrances)
    # From there another target has a line of its own.
    back, place = rig.q, rig.position
    rig.follow(lambda _: back, seconds=3.0, position=lambda _: place)
    assert norm(difference(rig.setpoints[-1].q, back)) < 1e-3
    rig.check()


def test_a_tolerance_that_suffices_changes_nothing():
    paths = []
    for tolerance in (float("inf"), 0.05):
        rig = ArmRig("ur5e", HOME, hardest=20.0, path_tolerance=tolerance)
        q = turning(rig.q, (0.0, 1.0, 0.0), 9.0, 1.2)(1.0)
        rig.follow(lambda _, q=q: q, seconds=2.0, position=lambda _, rig=rig: rig.position)
        paths.append([(s.q, s.position) for s in rig.setpoints])
    assert paths[0] == paths[1]


def configurations():
    """Yield the limits of the arms that the sources and the documentation configure."""
    root = Path(__file__).parents[3]
    for path in [root / "config/ur.toml", *sorted((root / "docs").rglob("*.md"))]:
        text = path.read_text()
        blocks = (
            [text]
            if path.suffix == ".toml"
            else re.findall(r"```.*?toml.*?\n(.*?)```", text, re.DOTALL)
        )
        for block in blocks:
            if 'driver = "ur"' in block and ".limits]" in block:
                lines = block[block.index("[devices") :]
                yield pytest.param(tomllib.loads(lines)["devices"]["arm"]["limits"], id=path.name)


@pytest.mark.parametrize("limits", list(configurations()))
def test_the_joints_keep_the_linear_limits_of_the_configurations(limits):
    way, speed, acceleration = 0.2, limits["linear_velocity"], limits["linear_acceleration"]
    for axis in range(3):
        rig = ArmRig("ur5e", HOME, **limits)
        goal = list(rig.position)
        goal[axis] += way
        rig.follow(lambda _, rig=rig: rig.q, seconds=1.5, position=lambda _, goal=goal: goal)
        away = [dist(one.position, goal) for one in rig.setpoints]
        came = next(k for k, gap in enumerate(away) if gap < 1e-3) * PERIOD
        # As quick as the linear limits alone would be.
        assert came < 1.03 * (way / speed + speed / acceleration)
        assert not rig.hindrances
        rig.check()
