"""The UR driver's parts without a robot: options, rotation vectors, clock, bytes, states."""

import math
import re
from dataclasses import asdict, fields
from pathlib import Path

import pytest

from orientd import config
from orientd.floats import exp, multiply
from orientd_ur import controller, options
from orientd_ur.arm import MODELS
from orientd_ur.pose import LONGEST, continued
from orientd_ur.timing import ControllerClock


def norm(r):
    return math.hypot(*r)


def same(q, p):
    return abs(abs(sum(a * b for a, b in zip(q, p, strict=True))) - 1.0) < 1e-15


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "host must be the robot's address, got None"),
        ({"host": " "}, "host must be"),
        ({"host": "r", "gian": 300}, "unknown option 'gian'"),
        ({"host": "r", "gain": 99}, "gain must be a number from 100 to 2000, got 99"),
        ({"host": "r", "gain": math.nan}, "gain must be"),
        ({"host": "r", "gain": True}, "gain must be"),
        ({"host": "r", "lookahead": 0.3}, "lookahead must be a number from 0.03 to 0.2"),
        ({"host": "r", "tcp_offset": [0, 0, 1]}, "tcp_offset must be 6 numbers"),
        ({"host": "r", "payload_cog": [0, 0, 1]}, "payload_cog needs payload_mass"),
        ({"host": "r", "release_brakes": "yes"}, "release_brakes must be true or false"),
        ({"host": "r", "link_timeout": 0.05, "feedback_timeout": 0.5}, "link_timeout must be"),
    ],
)
def test_option_that_is_not_allowed_is_named(given, words):
    with pytest.raises(ValueError, match=words.replace("(", r"\(")):
        options.check(given, period=0.002)


def test_defaults_are_those_that_are_documented():
    found = options.check({"host": "r"}, period=0.002)
    assert asdict(found) == {
        "host": "r", "model": None, "lookahead": 0.1, "gain": 300.0, "servo_time": 0.002,
        "start_joints": pytest.approx([0.0, -1.570796, 1.396263, -1.396263, -1.570796, 0.0]),
        "watchdog_hz": 10.0, "feedback_timeout": 0.1, "link_timeout": 0.5,
        "stop_deceleration": 10.0, "unlock_timeout": 8.0, "arrival_tolerance_deg": 0.5,
        "joint_acceleration_deg": pytest.approx(2291.8, abs=0.1), "tcp_offset": None,
        "payload_mass": None, "payload_cog": (0.0, 0.0, 0.0), "release_brakes": True,
        "keep_phase": True, "registers": "lower", "check_joints": True,
        "check_remote_control": True, "follow_tolerance_deg": 5.0,
    }  # fmt: skip
    assert found.joint_acceleration == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("lookahead", 0.03, 0.2), ("gain", 100, 2000), ("servo_time", 0.002, 0.1),
        ("watchdog_hz", 1, 100), ("feedback_timeout", 0.01, 0.5), ("link_timeout", 0.1, 2),
        ("stop_deceleration", 0.1, 40), ("unlock_timeout", 0.1, 15), ("payload_mass", 0, 50),
        ("arrival_tolerance_deg", 0.05, 10), ("follow_tolerance_deg", 0.5, 90),
        ("joint_acceleration_deg", 10, 4584),
    ],
)  # fmt: skip
def test_option_is_allowed_from_its_least_to_its_largest(name, least, most):
    for value in (least, most):
        assert getattr(options.check({"host": "r", name: value}, period=0.002), name) == value
    for value in (least - 0.001, most + 0.001):
        with pytest.raises(ValueError, match=name):
            options.check({"host": "r", name: value}, period=0.002)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"host": "q"}, "'host' is no option of one motion, those are: lookahead, gain"),
        ({"lookahead": 0.02}, "lookahead must be a number from 0.03 to 0.2, got 0.02"),
        ({"gain": "hard"}, "gain must be a number"),
    ],
)
def test_option_of_a_motion_that_is_not_allowed_is_named(given, words):
    chosen = options.check({"host": "r"}, period=0.002)
    with pytest.raises(ValueError, match=words):
        options.tuned(chosen, given)


def test_one_setpoint_commands_for_one_period():
    assert options.check({"host": "r"}, period=0.008).servo_time == 0.008


@pytest.mark.parametrize("angle", [0.0, 1e-160, 1e-9, 1.0, math.pi - 1e-9, math.pi])
def test_shortest_rotation_vector_is_the_rotation(angle):
    r = tuple(angle * a for a in (2 / 3, -1 / 3, 2 / 3))
    for q in (exp(r), tuple(-part for part in exp(r))):
        found = continued(q, (0.0, 0.0, 0.0))
        assert norm(found) == pytest.approx(angle, rel=1e-12, abs=1e-300)
        assert same(exp(found), exp(r))


@pytest.mark.parametrize(
    "axis", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.48, -0.6, 0.64)]
)
def test_rotation_vector_goes_on_beyond_pi_without_a_jump(axis):
    def turned(angle):
        return tuple(angle * a for a in axis)

    last = turned(3.0)
    for step in range(1, 160):
        r = continued(exp(turned(3.0 + 0.01 * step)), last)
        assert norm([a - b for a, b in zip(r, last, strict=True)]) < 0.0101
        last = r
    assert last == pytest.approx(turned(3.0 + 1.59))


def test_orientation_that_trembles_about_pi_never_jumps():
    last = (0.0, 0.0, 3.1)
    for step in range(400):
        q = multiply(exp((0.0, 0.0, math.pi)), exp((0.0, 0.0, 0.05 * math.sin(step))))
        r = continued(q, last)
        assert norm([a - b for a, b in zip(r, last, strict=True)]) < 0.1001
        last = r


def test_rotation_vector_is_the_orientation_and_never_long():
    last, jumps = (0.0, 0.0, 0.0), 0
    for step in range(4000):
        q = exp((0.0, 0.0, 0.01 * step))
        r = continued(q, last)
        assert same(exp(r), q)
        assert norm(r) <= LONGEST + 1e-12
        jumps += norm([a - b for a, b in zip(r, last, strict=True)]) > 0.1
        last = r
    # One change of side in every turn of 2 pi.
    assert jumps == 6


def test_clock_takes_the_fastest_package_for_the_offset():
    clock = ControllerClock()
    stamps = [100.0 + 0.002 * k for k in range(400)]
    delays = [300_000 + 50_000 * (k * 7 % 11) for k in range(400)]
    for stamp, delay in zip(stamps, delays, strict=True):
        now = round(stamp * 1e9) + 5_000_000_000 + delay
        measured = clock.measured_ns(stamp, now)
        assert measured <= now
    assert now - measured == delay - 300_000


def test_clock_never_goes_back_and_recovers_from_a_freeze():
    clock, last, now, stamp = ControllerClock(), 0, 10**9, 100.0
    for k in range(530):
        now += 2_000_000 if k != 500 else 1_000_000_000
        stamp += 0.002
        measured = clock.measured_ns(stamp, now)
        assert measured >= last
        last = measured
    assert now - measured < 1000


@pytest.mark.parametrize(
    ("robot_mode", "safety_mode", "words"),
    [
        (7, 1, ""),
        (7, 2, ""),
        (7, 3, "protective stop"),
        (3, 7, "emergency stop"),
        (7, 5, "safeguard"),
        (3, 1, "power off"),
        (3, 8, "violation"),
    ],
)
def test_obstacle_is_named_and_reduced_mode_is_none(robot_mode, safety_mode, words):
    found = controller.obstacle(robot_mode, safety_mode)
    assert words in found if words else not found


@pytest.mark.parametrize(
    ("runtime_state", "words"),
    [(0, "was stopped"), (1, "was stopped"), (2, ""), (3, "paused"), (4, "paused"),
     (5, "was stopped")],
)  # fmt: skip
def test_program_that_does_not_play_is_said_to_be_paused_or_stopped(runtime_state, words):
    found = controller.interruption(runtime_state)
    assert words in found if words else not found


def test_example_configuration_is_whole():
    path = Path(__file__).parents[3] / "config" / "ur.toml"
    device = config.load(path).devices["arm"]
    checked = options.check(device.options, period=device.period_ns * 1e-9)
    # The model is named, so that motions can be planned without the robot.
    assert checked == options.check({"host": "127.0.0.2", "model": "ur5e"}, period=0.002)
    mentioned = set(re.findall(r"^#? ?(\w+) = ", path.read_text(), re.MULTILINE))
    assert {field.name for field in fields(options.UrOptions)} <= mentioned


@pytest.mark.parametrize(
    ("joints", "elbow", "flange"),
    [
        # The published table, all joints zero and the shoulder upright.
        ((0.0,) * 6, (-0.425, 0.0, 0.1625), (-0.8172, -0.2329, 0.0628)),
        ((0.0, -math.pi / 2, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.5875), (-0.0997, -0.2329, 0.9797)),
    ],
)
def test_frames_are_where_the_published_table_says(joints, elbow, flange):
    origins = MODELS["ur5e"].arm().kinematics.frames(joints)
    assert origins[2] == pytest.approx(elbow, abs=1e-12)
    assert origins[-1] == pytest.approx(flange, abs=1e-12)
