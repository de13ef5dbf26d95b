"""A motion on the path that the axes of its device follow."""

import json
import re

import numpy as np
import pytest

from orientd import load_motion
from orientd.driver import AxisLimits
from orientd.errors import LimitError, OrientdError
from orientd.mechanism.figure import Figure
from orientd.mechanism.joint_path import JointPath
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner import certifying
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp, multiply

PERIOD = 0.01
LIMITS = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)


@pytest.fixture(scope="module")
def motion():
    vectors = ([0, 0, 0], [0.4, -0.2, 0.3], [0.1, 0.5, 0.8], [0.6, 0.3, 0.2])
    positions = ([0, 0, 0], [0.1, 0, 0], [0.2, 0.1, 0], [0.2, 0.2, 0.1])
    keyframes = [
        Keyframe(q=exp(np.array(v)), position=np.array(p, dtype=float))
        for v, p in zip(vectors, positions, strict=True)
    ]
    request = MotionRequest(keyframes=keyframes, start_velocity=np.array([0, 0, 0.3]),
                            velocity_frame="body", approach=True)  # fmt: skip
    return plan(request, start=State.at_rest([1, 0, 0, 0]), limits=LIMITS, period=PERIOD)


def limits_of(velocity=np.inf, acceleration=np.inf, jerk=np.inf):
    return [AxisLimits("yaw", -np.inf, np.inf, velocity, acceleration, jerk)]


def shape_of(motion, q=None, course=None, joints=None, **more):
    table = motion.records(0, motion.record_count)[:, :4] if q is None else q
    times = PERIOD * np.arange(len(table)) if course is None else course
    joints = np.linspace(0.0, 1.0, len(table)) if joints is None else joints
    return JointPath(PERIOD, joints[:, None], table, times, **more)


def reshaped(motion, shape, axes=None):
    return certifying.reshaped(motion, shape, limits_of() if axes is None else axes)


def test_same_path_as_a_table_is_the_same_motion(motion):
    figure = Figure("velocity of yaw", 1.0, "rad/s", 2.0, 0.5)
    table = reshaped(motion, shape_of(motion, figures=(figure,), notes=("as asked",)))
    assert table.records(0, table.record_count)[:, :4] == pytest.approx(
        motion.records(0, motion.record_count)[:, :4], abs=1e-15
    )
    for name in ("peak_velocity", "peak_acceleration", "brake_rate"):
        ours, theirs = getattr(table.certificate, name), getattr(motion.certificate, name)
        ours, theirs = getattr(ours, "value", ours), getattr(theirs, "value", theirs)
        assert ours == pytest.approx(theirs, rel=1e-6)
    assert table.keyframe_times == pytest.approx(motion.keyframe_times, abs=0)
    assert table.certificate.keyframe_error < 1e-4
    assert table.certificate.start_velocity_error < 1e-9
    assert (table.certificate.figures[-1], table.certificate.notes[-1]) == (figure, "as asked")
    assert (table.first_joints, table.last_joints) == ((0.0,), (1.0,))


def test_table_meets_the_motion_between_its_records(motion):
    table = reshaped(motion, shape_of(motion))
    times = np.linspace(-0.1, motion.duration + 0.1, 1777)
    ours, theirs = table.sample(times), motion.sample(times)
    assert np.max(angle(ours.q, theirs.q)) < 1e-4
    assert ours.omega_body == pytest.approx(theirs.omega_body, abs=2e-2)
    assert ours.position == pytest.approx(theirs.position, abs=1e-5)
    assert ours.velocity == pytest.approx(theirs.velocity, abs=5e-3)
    assert np.linalg.norm(ours.q, axis=1) == pytest.approx(1.0, abs=1e-12)


def test_velocities_of_a_table_are_derivatives(motion):
    path = reshaped(motion, shape_of(motion)).path
    times, step = np.linspace(0.1, motion.duration - 0.1, 333) + 1e-3, 1e-6
    before, after = path.sample(times - step), path.sample(times + step)
    from orientd.rotation import conjugate, log

    omega = log(multiply(conjugate(before.q), after.q)) / (2 * step)
    assert path.sample(times).omega_body == pytest.approx(omega, abs=1e-6)


def test_path_that_stands_still_on_the_way_keeps_position_and_keyframes_with_it(motion):
    count, at, stay = motion.record_count, motion.record_count // 2, 200
    grid = PERIOD * np.arange(count)
    # Slow down and up again around the stop, as an axis that slews would.
    ease = np.linspace(0, 1, 400)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    course = np.concatenate([grid[at] * ease, np.full(stay, grid[at]),
                             grid[at] + (grid[-1] - grid[at]) * ease])  # fmt: skip
    table = reshaped(motion, shape_of(motion, motion.sample(course).q, course))
    assert table.duration == pytest.approx((len(course) - 1) * PERIOD)
    standing = table.sample([(400 + 50) * PERIOD])
    assert standing.position[0] == pytest.approx(motion.sample([grid[at]]).position[0], abs=1e-12)
    assert standing.velocity[0] == pytest.approx([0, 0, 0], abs=1e-12)
    assert np.all(np.diff(table.keyframe_times) > 0)
    assert table.certificate.keyframe_error < 0.02
    assert table.start_time == table.keyframe_times[0]


def test_shape_that_breaks_a_limit_is_refused(motion):
    q = motion.records(0, motion.record_count)[:, :4]
    q[100] = multiply(q[100], exp(np.array([0.01, 0, 0])))
    with pytest.raises(LimitError, match=r"angular (jerk|acceleration)"):
        reshaped(motion, shape_of(motion, q))


def test_brake_rate_counts_the_joints(motion):
    s = np.linspace(0.0, 1.0, motion.record_count)
    joint = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    speed, bend = (float(np.abs(np.diff(joint, n)).max()) / PERIOD**n for n in (1, 2))
    turns = shape_of(motion, joints=joint)
    free = reshaped(motion, turns)
    assert free.certificate.brake_rate == motion.certificate.brake_rate
    # With none of the acceleration used it would be 1 / (2 speed); where 0.8 is used, less.
    most = 0.5 * 1.25 * bend / speed
    some = reshaped(motion, turns, limits_of(2.0 * speed, 1.25 * bend)).certificate
    assert 0.6 * most < some.brake_rate < 1.02 * most
    # Hardly anything left to brake with: slower than the tool.
    tight = reshaped(motion, turns, limits_of(9.0, 1.0004 * bend)).certificate
    assert tight.brake_rate < 0.6 * free.certificate.brake_rate
    assert tight.stop_time == min(1.0 / tight.brake_rate, tight.duration)


def test_a_certificate_has_the_proven_peaks_of_the_axes_and_their_ways(motion):
    s = np.linspace(0.0, 1.0, motion.record_count)
    joint = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    shape = shape_of(motion, joints=joint)
    certificate = reshaped(motion, shape, limits_of(9.0, 900.0, 9e4)).certificate
    for order, (kind, limit) in enumerate(
        (("velocity", 9.0), ("acceleration", 900.0), ("jerk", 9e4)), 1
    ):
        figure = next(one for one in certificate.figures if one.name == f"{kind} of yaw")
        found = float(np.abs(np.diff(joint, order)).max()) / PERIOD**order
        assert found <= figure.value <= 1.005 * found
        assert figure.limit == limit
    (least,) = (one for one in certificate.figures if one.name == "least angle of yaw")
    assert least.value == 0.0
    (words,) = certificate.notes
    assert re.fullmatch(r"yaw: 0\.0 to 57\.3 deg, at most [\d.]+ deg/s at [\d.]+ s .*", words)


def test_joint_beyond_a_limit_between_two_records_is_refused(motion):
    s = np.linspace(0.0, 1.0, motion.record_count)
    joint = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    bend = float(np.abs(np.diff(joint, 2)).max()) / PERIOD**2
    with pytest.raises(LimitError, match=r"acceleration of yaw reaches .* between two records"):
        reshaped(motion, shape_of(motion, joints=joint), limits_of(99.0, 0.995 * bend))
    speed = float(np.abs(np.diff(joint)).max()) / PERIOD
    with pytest.raises(LimitError, match="velocity of yaw reaches"):
        reshaped(motion, shape_of(motion, joints=joint), limits_of(0.995 * speed, 999.0))
    twist = float(np.abs(np.diff(joint, 3)).max()) / PERIOD**3
    with pytest.raises(LimitError, match=r"jerk of yaw reaches .* between two records"):
        reshaped(motion, shape_of(motion, joints=joint), limits_of(99.0, 999.0, 0.995 * twist))


def test_a_saved_motion_keeps_its_joints_and_their_velocities(motion, tmp_path):
    joint = np.linspace(0.0, 1.0, motion.record_count) ** 2 * np.ones((1, 1))
    shaped = reshaped(motion, shape_of(motion, joints=joint[0]), limits_of(99.0, 999.0))
    shaped.save(tmp_path / "new.npz")
    records = shaped.records(0, shaped.record_count)
    assert np.isfinite(records[:, [16, 24]]).all()
    back = load_motion(tmp_path / "new.npz")
    assert np.array_equal(back.records(0, back.record_count), records, equal_nan=True)
    with np.load(tmp_path / "new.npz") as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    del header["axes"]
    np.savez(tmp_path / "old.npz", **{**arrays, "header": np.array(json.dumps(header))})
    with pytest.raises(OrientdError, match="do not count the device's axes; plan it again"):
        load_motion(tmp_path / "old.npz")
