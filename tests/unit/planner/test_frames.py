"""The same motion, said in any frame, is the same; reports are in the frame it was said in."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planned import LIMITS, PERIOD
from scipy.spatial.transform import Rotation

from orientd import motion_file
from orientd.driver import make_driver
from orientd.errors import RequestError
from orientd.model.request import Frame, Keyframe, MotionRequest, Pose
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.offline import plan_offline
from orientd.planner.planning import plan
from orientd.planner.resolve import in_device_coordinates, report_frame
from orientd.planner.state import State
from orientd.rotation import angle, rotate

LARGEST = LIMITS["quick"]
TIMES = (0.0, 1.5, 3.0)


def named(rotation):
    x, y, z, w = rotation.as_quat().tolist()
    return w, x, y, z


def matrix(q, position):
    """Return the homogeneous matrix of a pose, by SciPy alone."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat([*q[1:], q[0]]).as_matrix()
    found[:3, 3] = position
    return found


def pose(found):
    return named(Rotation.from_matrix(found[:3, :3])), tuple(found[:3, 3].tolist())


def random_pose(source, reach=1.0):
    return Pose(
        named(Rotation.random(random_state=source)), tuple(source.uniform(-reach, reach, 3))
    )


def random_request(source, *, is_timed, velocity_frame):
    q, place, keyframes = Rotation.random(random_state=source), source.uniform(-1, 1, 3), []
    for time in TIMES:
        keyframes.append(Keyframe(named(q), time if is_timed else None, tuple(place)))
        q = q * Rotation.from_rotvec(source.uniform(-0.3, 0.3, 3))
        place = place + source.uniform(-0.05, 0.05, 3)
    return MotionRequest(
        keyframes,
        approach=True,
        start_velocity=tuple(source.uniform(-0.1, 0.1, 3)),
        end_velocity=tuple(source.uniform(-0.1, 0.1, 3)),
        velocity_frame=velocity_frame,
    )


def said_in(request, frames, names, are_relative, start):
    """Return the same request, with each keyframe in a frame, calculated with matrices."""
    keyframes, axes = [], []
    for keyframe, name, is_relative in zip(request.keyframes, names, are_relative, strict=True):
        frame = frames[name]
        base, tool = matrix(*astuple(frame.base)), matrix(*astuple(frame.tool))
        if is_relative:
            base = matrix(start.q, start.position) @ tool
        q, place = pose(np.linalg.inv(base) @ matrix(keyframe.q, keyframe.position) @ tool)
        given = {"position": place, "frame": name, "relative": is_relative}
        keyframes.append(replace(keyframe, q=q, **given))
        axes.append((tool if request.velocity_frame == "body" else base)[:3, :3].T)
    return replace(
        request,
        keyframes=keyframes,
        start_velocity=tuple(axes[0] @ request.start_velocity),
        end_velocity=tuple(axes[-1] @ request.end_velocity),
        frames=frames,
    )


def astuple(pose):
    return pose.q, pose.position


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    names=st.lists(st.sampled_from(["table", "camera"]), min_size=3, max_size=3),
    are_relative=st.lists(st.booleans(), min_size=3, max_size=3),
    velocity_frame=st.sampled_from(["body", "world"]),
    timing=st.sampled_from(["times", "even", "quickest"]),
)
def test_the_same_motion_said_in_any_frame_sends_the_same_setpoints(
    seed, names, are_relative, velocity_frame, timing
):
    source = np.random.default_rng(seed)
    frames = {
        "table": Frame(random_pose(source), Pose()),
        "camera": Frame(random_pose(source), random_pose(source, 0.2)),
    }
    request = random_request(source, is_timed=timing == "times", velocity_frame=velocity_frame)
    if timing == "even":
        request = replace(request, pace="even")
    first = request.keyframes[0]
    start = State.at_rest(first.q, np.add(first.position, [0.01, 0.0, 0.0]))
    said = said_in(request, frames, names, are_relative, start)
    sent, same = (plan(one, start=start, limits=LARGEST, period=PERIOD) for one in (request, said))
    assert sent.record_count == same.record_count
    a, b = (one.sample(PERIOD * np.arange(one.record_count)) for one in (sent, same))
    nearest = np.minimum(np.abs(a.q - b.q).max(axis=1), np.abs(a.q + b.q).max(axis=1))
    assert nearest.max() < 1e-12
    assert np.abs(a.position - b.position).max() < 1e-12


def test_reports_are_what_was_asked_for():
    source = np.random.default_rng(2)
    camera = Frame(random_pose(source), random_pose(source, 0.2))
    q, turned = named(Rotation.identity()), named(Rotation.from_rotvec([0.0, 0.2, 0.1]))
    keyframes = [Keyframe(q, 0.0, (0.1, 0.2, 0.3)), Keyframe(turned, 2.0, (0.1, 0.25, 0.3))]
    request = MotionRequest(
        keyframes, frame="camera", frames={"camera": camera}, end_velocity=(0.0, 0.1, 0.0)
    )
    motion = plan_offline(request, limits=LARGEST)
    frame = report_frame(request)
    times = np.linspace(0.0, motion.end_time, 4001)
    seen = motion.sample(times).seen_in(frame)
    at_end = motion.sample(np.array([motion.end_time])).seen_in(frame)
    assert angle(at_end.q[0], turned) < 1e-9
    assert at_end.position[0] == pytest.approx([0.1, 0.25, 0.3], abs=1e-9)
    assert at_end.omega_body[0] == pytest.approx([0.0, 0.1, 0.0], abs=1e-6)
    # The velocity is that of the tool, lever arm included: the derivative of its position.
    measured = np.gradient(seen.position, times, axis=0)
    assert np.abs(measured - seen.velocity)[1:-1].max() < 1e-4
    spun = np.gradient(seen.omega_body, times, axis=0)
    assert np.abs(spun - seen.alpha_body)[1:-1].max() < 1e-3


def test_only_keyframes_that_agree_name_the_frame_of_reports():
    frames = {"table": Frame(Pose(position=(1.0, 0.0, 0.0))), "camera": Frame()}
    one, other = Keyframe((1.0, 0.0, 0.0, 0.0), frame="table"), Keyframe((0.0, 1.0, 0.0, 0.0))
    assert report_frame(MotionRequest([one, one], frames=frames)) == frames["table"]
    assert report_frame(MotionRequest([one, other], frames=frames)) is None
    assert report_frame(MotionRequest([one, other], frame="camera", frames=frames)) == Frame()


def test_what_points_is_the_axis_of_the_frames_tool():
    camera = {"tool": {"euler": {"axes": "y", "degrees": [90]}}}
    keyframes = [{"direction": [1, 2, 3]}, {"direction": [2, 0, 1]}]
    request = motion_file.parse(
        {"keyframes": keyframes, "frame": "camera", "frames": {"camera": camera},
         "pointing_axis": "z"}
    )  # fmt: skip
    placed = in_device_coordinates(request, State.at_rest((1.0, 0.0, 0.0, 0.0)))
    # The tool's z axis is the flange's x axis.
    for keyframe, direction in zip(placed.keyframes, ([1, 2, 3], [2, 0, 1]), strict=True):
        points = rotate(keyframe.q, [1.0, 0.0, 0.0])
        assert points == pytest.approx(np.array(direction) / np.linalg.norm(direction), abs=1e-12)


def test_frames_of_a_configuration_give_way_to_those_of_the_motion():
    configured = {"camera": Frame(tool=Pose(position=(0.0, 0.0, 1.0))), "table": Frame()}
    planner = DevicePlanner(
        make_driver("arm", "loopback", {}, 2_000_000),
        limits=LARGEST,
        period=0.002,
        frames=configured,
    )
    keyframe = Keyframe((1.0, 0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0), frame="camera")
    (placed,) = planner.placed(MotionRequest([keyframe]), None).keyframes
    assert placed.position == (0.0, 0.0, -1.0)
    own = {"camera": Frame(tool=Pose(position=(0.0, 2.0, 0.0)))}
    (placed,) = planner.placed(MotionRequest([keyframe], frames=own), None).keyframes
    assert placed.position == (0.0, -2.0, 0.0)


def test_a_request_without_frames_stays_the_very_same():
    request = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0))])
    assert in_device_coordinates(request, None) is request


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"frame": "camra", "frames": {"camera": {}}},
         r"^keyframes\[0\]\.frame: expected one of camera, got 'camra'$"),
        ({"frame": "camera"}, r"^keyframes\[0\]\.frame: there are no frames here, got 'camera'; "),
    ],
)  # fmt: skip
def test_an_unknown_frame_is_named_with_those_that_are_known(mapping, message):
    request = motion_file.parse({"keyframes": [{"rotation_vector": [0, 0, 1]}], **mapping})
    with pytest.raises(RequestError, match=message):
        in_device_coordinates(request, None)


def test_relative_keyframes_need_to_know_where_the_device_is():
    request = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0), relative=True)])
    with pytest.raises(RequestError, match=r"relative: the current orientation is unknown"):
        in_device_coordinates(request, None)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ({"a b": {}}, r"^frames: expected a letter, then at most 31"),
        ({"cam": {"bse": {}}}, r"^frames\.cam\.bse: unknown key"),
        ({"cam": {"tool": {"direction": [1, 0, 0]}}}, r"^frames\.cam\.tool\.direction: unknown"),
        ({"cam": {"tool": {"position": [0, 0, 1e7]}}}, r"^frames\.cam\.tool\.position: expected"),
        ({"cam": {"base": {"quaternion": {"w": 1, "x": 1, "y": 0, "z": 0}}}},
         r"^frames\.cam\.base\.quaternion: "),
        ({"cam": {"base": {"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}}},
         r"^frames\.cam\.base\.matrix: "),
        ({f"f{k}": {} for k in range(101)}, r"^frames: expected at most 100, got 101"),
    ],
)  # fmt: skip
def test_a_frame_that_is_none_is_refused_by_its_place(frames, message):
    with pytest.raises(RequestError, match=message):
        motion_file.parse({"keyframes": [{"rotation_vector": [0, 0, 1]}], "frames": frames})
