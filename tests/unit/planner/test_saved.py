"""Motions and requests outlive the process: pickles, files, equality."""

import json
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from planned import LIMITS, random_motions
from scipy.spatial.transform import Rotation

import orientd
from orientd import plots
from orientd.driver import AxisLimits
from orientd.errors import OrientdError, RequestError
from orientd.mechanism.joint_path import JointPath
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certifying import reshaped
from orientd.rotation import Quaternion, angle

KEYS = Rotation.from_rotvec([[0, 0, 0], [0, 0.2, 0.5], [0.3, 0, 0.9]])
ENDS = {"start_velocity": [0, 0, 0.4], "end_velocity": [0.2, 0, 0.3], "approach": True}
POSITIONS = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0.1]]


def shaped():
    motion = orientd.plan(KEYS)
    times = motion.period * np.arange(motion.record_count)
    q = motion.sample(times).q
    joints = np.cumsum(np.ones((len(q), 2)), axis=0) * 1e-3
    axes = [AxisLimits(name, -10.0, 10.0, 9.0, 1e4) for name in ("pan", "tilt")]
    return reshaped(motion, JointPath(motion.period, joints, q, times), axes)


def motions():
    yield "plain", orientd.plan(KEYS, times=[0, 1, 2.2])
    yield "with leads", orientd.plan(KEYS, **ENDS)
    yield "with positions", orientd.plan(KEYS, positions=POSITIONS)
    yield "quickest", orientd.plan(KEYS, duration="minimum")
    yield "turns", orientd.plan(KEYS, turns=[1, 0])
    yield "axes", orientd.plan(KEYS, limits={"velocity": [1, 2, 1]})
    yield (
        "options",
        orientd.plan(KEYS, method="minimum_effort", options={"inertia": np.array([1.0, 2.0, 3.0])}),
    )
    yield "least", orientd.plan(KEYS, method="min_acceleration", approach=True)
    keyframes = [Keyframe((1.0, 0.0, 0.0, 0.0), name="here"), Keyframe((0.8, 0.0, 0.0, 0.6))]
    yield "names", orientd.plan(MotionRequest(keyframes))
    yield "shaped", shaped()
    first = orientd.plan(KEYS)
    start = first.state_at(first.record_count // 2)
    yield "taken over", orientd.plan([KEYS[0]], start=start)


MOTIONS = dict(motions())


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_is_pickled_and_equal_to_what_comes_back(name):
    motion = MOTIONS[name]
    back = pickle.loads(pickle.dumps(motion))
    assert back == motion
    assert back.id == motion.id
    assert hash(back) == hash(motion)
    assert back.request == motion.request
    assert back.certificate == motion.certificate


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_from_a_file_is_the_one_that_was_saved(name, tmp_path):
    motion, path = MOTIONS[name], tmp_path / "a.motion"
    motion.save(path)
    back = orientd.load_motion(path)
    assert back == motion
    assert (back.id, back.duration, back.certificate) == (
        motion.id,
        motion.duration,
        motion.certificate,
    )
    assert np.array_equal(
        back.records(0, back.record_count), motion.records(0, motion.record_count), equal_nan=True
    )
    assert replace(back.facts, limits=None) is not None
    for ours, theirs in zip(
        (back.recorded().rows(-3, 3), back.state_at(5).q),
        (motion.recorded().rows(-3, 3), motion.state_at(5).q),
        strict=True,
    ):
        assert ours == pytest.approx(theirs, abs=1e-12)


@pytest.mark.parametrize("name", MOTIONS)
def test_between_its_records_a_motion_from_a_file_is_near(name, tmp_path):
    motion, path = MOTIONS[name], tmp_path / "a.motion"
    motion.save(path)
    back = orientd.load_motion(path)
    times = np.linspace(-0.01, motion.duration + 0.01, 3001)
    ours, theirs = back.sample(times), motion.sample(times)
    assert angle(ours.q, theirs.q).max() < 1e-6
    assert np.abs(ours.omega_body - theirs.omega_body).max() < 1e-2
    assert np.abs(ours.position - theirs.position).max() < 1e-6


def test_a_motion_is_not_saved_under_the_name_of_another_format(tmp_path):
    with pytest.raises(OrientdError, match=r"saved as \.npz, got 'move\.csv'"):
        MOTIONS["plain"].save(tmp_path / "move.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("motion", random_motions(5, 3, LIMITS["arm"]))
def test_random_motions_are_saved(motion, tmp_path):
    motion.save(tmp_path / "a.npz")
    assert orientd.load_motion(tmp_path / "a.npz") == motion


def test_motions_differ_by_what_they_were_made_of():
    motion = MOTIONS["plain"]
    assert orientd.plan(KEYS, times=[0, 1, 2.2]) == motion
    assert orientd.plan(KEYS, times=[0, 1, 2.3]) != motion
    assert orientd.plan(KEYS, times=[0, 1, 2.2], limits={"jerk": 8000}) != motion
    assert motion != "a motion"


def test_a_file_that_is_no_motion_is_refused(tmp_path):
    with pytest.raises(OrientdError, match=r"cannot read .*none"):
        orientd.load_motion(tmp_path / "none")
    path = tmp_path / "text"
    path.write_text("time,q\n")
    with pytest.raises(OrientdError, match="is not a motion saved by orientd"):
        orientd.load_motion(path)
    np.savez(tmp_path / "other.npz", rows=np.zeros(3))
    with pytest.raises(OrientdError, match="is not a motion saved by orientd"):
        orientd.load_motion(tmp_path / "other.npz")
    with pytest.raises(OrientdError, match="cannot write"):
        MOTIONS["plain"].save(tmp_path)


def changed(path, tmp_path, **changes):
    with np.load(path) as archive:
        arrays = dict(archive)
    header = {**json.loads(str(arrays["header"])), **changes}
    np.savez(tmp_path / "b.npz", **{**arrays, "header": np.array(json.dumps(header))})
    return tmp_path / "b.npz"


def test_a_file_of_a_later_version_says_so(tmp_path):
    MOTIONS["plain"].save(tmp_path / "a.npz")
    with pytest.raises(OrientdError, match=r"has version 2 of the format.*expected 1"):
        orientd.load_motion(changed(tmp_path / "a.npz", tmp_path, version=2))


def test_a_damaged_file_says_so(tmp_path):
    MOTIONS["plain"].save(tmp_path / "a.npz")
    with pytest.raises(OrientdError, match="is damaged"):
        orientd.load_motion(changed(tmp_path / "a.npz", tmp_path, certificate={}))
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(OrientdError, match="is not a motion"):
        orientd.load_motion(tmp_path / "half.npz")


def test_a_header_of_characters_that_do_not_exist_says_so(tmp_path):
    MOTIONS["plain"].save(tmp_path / "a.npz")
    key = "free_roll".encode("utf-32-le")
    wrong = key[:4] + b"\0\0\x11\0" + key[8:]  # U+110000 is none
    with (
        zipfile.ZipFile(tmp_path / "a.npz") as good,
        zipfile.ZipFile(tmp_path / "b.npz", "w") as bad,
    ):
        assert key in good.read("header.npy")
        for name in good.namelist():
            bad.writestr(name, good.read(name).replace(key, wrong))
    with pytest.raises(OrientdError, match="not a motion saved by orientd: 'utf-32"):
        orientd.load_motion(tmp_path / "b.npz")


def test_a_file_holds_nothing_that_runs(tmp_path):
    MOTIONS["plain"].save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert all(archive[name].dtype.kind in "fU" for name in archive.files)


def test_requests_are_equal_that_ask_for_the_same():
    def request(**fields):
        return MotionRequest([Keyframe((1, 0, 0, 0), 0.0), Keyframe((0, 1, 0, 0), 1.0)], **fields)

    options = {"inertia": np.array([1.0, 2.0, 3.0])}
    one = request(method="minimum_effort", options=options)
    assert one == request(method="minimum_effort", options={"inertia": [1.0, 2.0, 3.0]})
    assert one != request(method="minimum_effort")
    assert one != "a request"
    assert pickle.loads(pickle.dumps(one)) == one
    assert hash(pickle.loads(pickle.dumps(one))) == hash(one)
    assert repr(request(approach=True)).endswith("method='c2_cumulative', approach=True)")


def test_a_motion_shows_what_it_is():
    text = repr(MOTIONS["with leads"])
    assert "c2_cumulative through 3 keyframes" in text
    assert "500 Hz" in text
    assert len(text) < 250


def test_a_motion_gives_rotations():
    motion = MOTIONS["plain"]
    assert (motion(0.0) * KEYS[0].inv()).magnitude() < 1e-12
    assert (motion([0.0, 1.0, 2.2]) * KEYS.inv()).magnitude().max() < 1e-9


def test_keyframes_of_a_plan_say_their_order():
    named = Quaternion.from_array(KEYS.as_quat(), order="xyzw")
    assert orientd.plan(named, times=[0, 1, 2.2]) == MOTIONS["plain"]
    with pytest.raises(RequestError, match="a bare sequence does not say its order"):
        orientd.plan([[1, 0, 0, 0], [0, 1, 0, 0]])
    with pytest.raises(RequestError, match="times: expected 3, one for each keyframe, got 2"):
        orientd.plan(KEYS, times=[0, 1])
    with pytest.raises(RequestError, match="turns: expected 2, one for each interval"):
        orientd.plan(KEYS, turns=[0, 1, 0])


def test_limits_of_a_plan_are_kept():
    motion = orientd.plan(KEYS, limits={"velocity": 0.5})
    assert motion.certificate.peak_velocity.value <= 0.5
    assert motion.limits == DEFAULT_LIMITS.with_rates({"velocity": 0.5})


def test_a_motion_shows_its_picture_in_a_notebook(tmp_path):
    pytest.importorskip("matplotlib")
    assert plots.picture(MOTIONS["plain"])._repr_png_().startswith(b"\x89PNG")
    MOTIONS["plain"].save(tmp_path / "a.npz")
    plots.draw(orientd.load_motion(tmp_path / "a.npz"), tmp_path / "a.svg")
    assert "trace-x" in (tmp_path / "a.svg").read_text()
