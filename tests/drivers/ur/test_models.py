"""Every arm at the driver: what its controller says, what it can and cannot follow."""

import math
import random

import numpy as np
import pytest
from ur_rig import device_of, driver_of, stream_of, unopened, until

from emulated_ur import MODELS, EmulatedRobot
from emulated_ur.arm.kinematics import Kinematics
from emulated_ur.arm.transforms import from_pose, inverse
from emulated_ur.arm.transforms import multiply as times
from orientd.errors import DeviceFaultError, LinkError, PlanError
from orientd.floats import exp, log, multiply
from orientd.mechanism.routing import check_way, joints_along
from orientd_ur.arm import MODELS as ARMS
from orientd_ur.primary import ask
from orientd_ur.probe import whereabouts

STEP = 0.008


def random_turn(generator, pose):
    """A turn about the tool's tip from rest to rest, up to 1.5 rad/s at its peak."""
    axis = [generator.gauss(0, 1) for _ in range(3)]
    length = math.hypot(*axis)
    angle, peak = generator.uniform(0.2, 2.8), generator.uniform(0.3, 1.5)
    duration = 1.875 * angle / peak
    path, (start, position) = [], pose
    count = math.ceil(duration / STEP)
    for k in range(count + 1):
        s = k / count
        turned = angle * (10 * s**3 - 15 * s**4 + 6 * s**5)
        q = multiply(start, exp(tuple(turned * a / length for a in axis)))
        path.append((q, position))
    return [k * duration / count for k in range(count + 1)], path


def follows(model, joints, tcp_offset, times_s, path):
    """How hard it is by the emulator's own kinematics: beyond 1 the arm cannot."""
    kinematics, back, near = Kinematics(model), inverse(from_pose(tcp_offset)), joints
    worst, found = 0.0, []
    for q, position in path:
        near = kinematics.inverse(times(from_pose((*position, *log(q))), back), near)
        if near is None or (found and np.max(np.abs(np.subtract(near, found[-1]))) > 0.5):
            return math.inf
        found.append(near)
        worst = max(worst, *(abs(a) / most for a, most in zip(near, model.ranges, strict=True)))
    period = times_s[1]
    speeds = np.diff(found, axis=0) / period
    changes = np.diff(speeds, axis=0) / period / 40.0
    return max(worst, np.max(np.abs(speeds) / model.speeds), np.max(np.abs(changes)))


def too_fast(joints, period, axes):
    """The first axis that its limits of velocity and acceleration do not allow, or nothing."""
    for order, name in ((1, "velocity"), (2, "acceleration")):
        most = np.abs(np.diff(joints, order, axis=0)).max(axis=0) / period**order
        for value, axis in zip(most, axes, strict=True):
            if value > 1.001 * getattr(axis, name):
                return f"{name} of {axis.name}"
    return ""


def decisions(robot, model, count):
    """For each of some random turns whether the driver takes it, and how hard it is."""
    driver, place = unopened(robot.host, rate_hz=125), whereabouts(robot.host)
    for number in range(count):
        times_s, path = random_turn(random.Random(number), place.pose)
        turn, offset = place.tool
        worst = follows(model, place.joints, (*offset, *log(turn)), times_s, path)
        q, position = np.array([q for q, _ in path]), np.array([p for _, p in path])
        try:
            arm = driver.mechanism(may_ask=True)
            joints = joints_along(arm, np.array(times_s), q, position, place.joints)
            check_way(arm, joints, np.array(times_s))
            refusal = too_fast(joints, times_s[1], arm.axes)
        except PlanError as error:
            refusal = str(error)
        yield worst, refusal


def assert_decided_as_published(host, name, count):
    with EmulatedRobot(host, "--model", name) as robot:
        for worst, refusal in decisions(robot, MODELS[name], count):
            if not 0.98 <= worst <= 1.02:
                assert (worst > 1.0) == bool(refusal), (name, worst, refusal)


@pytest.mark.parametrize("name", ["ur3e", "ur20"])
def test_turns_are_taken_and_refused_as_by_the_published_kinematics(ur_host, name):
    assert_decided_as_published(ur_host, name, 8)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MODELS))
def test_sixty_turns_of_every_arm_are_decided_as_published(ur_host, name):
    assert_decided_as_published(ur_host, name, 60)


def test_controller_is_asked_for_its_arm_and_its_limits(ur_host):
    with EmulatedRobot(ur_host, "--model", "ur20"):
        arm = ask(ur_host, 5.0)
    assert (arm.name, arm.kinematics.links.upper_arm) == ("ur20", 0.862)
    assert [round(math.degrees(axis.velocity)) for axis in arm.axes] == [
        120,
        120,
        150,
        210,
        210,
        210,
    ]


def test_another_arm_than_the_named_one_is_refused_in_words(ur_host):
    with EmulatedRobot(ur_host, "--model", "ur10e"):
        with pytest.raises(LinkError, match=r"has a ur10e, `model` says ur3"):
            unopened(ur_host, rate_hz=125, model="ur3").mechanism(may_ask=True)
        with pytest.raises(LinkError, match=r"has a ur10e, `model` says ur5e"):
            unopened(ur_host, rate_hz=125, model="ur5e").open()
        blind = unopened(ur_host, rate_hz=125, model="ur3", check_joints=False)
        assert blind.mechanism(may_ask=True) is None


def test_cb3_is_driven_at_its_own_rate_without_remote_control(ur_host):
    with EmulatedRobot(ur_host, "--model", "ur10") as robot:
        with pytest.raises(LinkError, match=r"every 8 ms: `rate_hz` must be 125 at the most"):
            unopened(ur_host, rate_hz=500).open()
        with stream_of(ur_host, model="ur10", rate_hz=125) as stream:
            _, _, z = stream.position
            for _ in range(30):
                stream.send(shift=(0.0, 0.0, -1e-5))
                stream.step()
            robot.wait_until(lambda state: state["actual_pose"][2] < z - 1e-4)


def test_polyscope_x_moves_without_a_dashboard_and_says_what_it_lacks(ur_host):
    with EmulatedRobot(ur_host, "--polyscope", "10.10.0") as robot:
        with driver_of(ur_host) as driver:
            (notice,) = driver.notices()
            assert "PolyScope X has no dashboard server: unlock protective stops" in notice
            driver.enable()
            robot.ask("protective_stop")
            robot.wait_until(lambda state: state["safety_mode"] == "PROTECTIVE_STOP")
            until(lambda: driver._link.modes()[1] == 3, "the stop")
            with pytest.raises(DeviceFaultError, match="protective stop: look for its cause"):
                driver.reset()
        (row,) = (one for one in driver.diagnose() if one.name == "remote control")
        assert "on the pendant" in row.mend


def test_arm_is_drawn_as_the_model_that_the_controller_has(ur_host):
    with EmulatedRobot(ur_host, "--model", "ur20"), device_of(ur_host) as device:
        assert device.outline() == ()  # asked for aside: whoever draws does not wait
        (line,) = until(device.outline, "the outline")
        joints = device.snapshot().cycle.joints
    assert line[-1] == pytest.approx(ARMS["ur20"].arm().forward(joints)[1], abs=1e-3)
