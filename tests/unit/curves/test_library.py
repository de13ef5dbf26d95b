"""The curves as a library: orientations, names that all families share, pickles, equality."""

import json
import pickle
import subprocess
import sys
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orientd import plots
from orientd.curves import METHODS, ParameterError
from orientd.errors import OrientdError
from orientd.rotation import Quaternion, angle, conjugate, rotate

GOLDEN = sorted((Path(__file__).parents[2] / "data" / "golden").glob("*.json"))
TURNS = Rotation.from_rotvec(
    [[0, 0, 0], [0, 0.2, 0.5], [0.3, 0, 0.9], [0, -0.2, 1.3], [0.1, 0, 1.7]]
)
ABLE = [name for name in METHODS if METHODS[name].meets_end_velocities]
UNABLE = [name for name in METHODS if not METHODS[name].meets_end_velocities]


def is_pair(name):
    return "q0" in signature(METHODS[name]).parameters


def made(name, times="given", **given):
    count = 2 if is_pair(name) else 5
    if isinstance(times, str):
        times = 1.0 + 0.5 * np.arange(count)
    return METHODS[name](**{"keys": TURNS[:count], "times": times, **given})


@pytest.mark.parametrize("name", METHODS)
def test_every_family_takes_rotations_and_times_by_the_same_names(name):
    curve = made(name)
    assert curve.domain == (1.0, 1.5 if is_pair(name) else 3.0)
    ends = curve(curve.domain)
    assert isinstance(ends, Rotation)
    assert (ends * TURNS[[0, 1 if is_pair(name) else 4]].inv()).magnitude().max() < 1e-9


@pytest.mark.parametrize("name", METHODS)
def test_without_times_every_family_lasts_as_long_as_its_chords(name):
    steps = (TURNS[1:] * TURNS[:-1].inv()).magnitude()
    length = 0.5 * steps[: 1 if is_pair(name) else 4].sum()
    curve = made(name, times=None)
    assert curve.domain == pytest.approx((0.0, length), rel=1e-12)
    given = {"keys": TURNS[:2] if is_pair(name) else TURNS}
    assert METHODS[name](**given).domain == curve.domain


@pytest.mark.parametrize("frame", ["body", "world"])
@pytest.mark.parametrize("name", ABLE)
def test_velocities_have_the_same_names_and_frames(name, frame):
    first, last = [0.1, 0.2, 0.3], [0.0, -0.2, 0.4]
    curve = made(name, start_velocity=first, end_velocity=last, velocity_frame=frame)
    q, omega, _ = curve.ends()
    if frame == "world":
        omega = rotate(q, omega)
    assert omega == pytest.approx(np.array([first, last]), abs=1e-9)


@pytest.mark.parametrize("name", UNABLE)
def test_a_family_that_cannot_prescribe_velocities_says_so(name):
    with pytest.raises(ValueError, match=r"end_velocity must be None.*cannot prescribe"):
        made(name, end_velocity=[0, 0, 1])


@pytest.mark.parametrize("name", ["slerp", "kks_hermite", "c2_cumulative", "kks_interpolating"])
def test_turns_are_one_name(name):
    turns = [1] if is_pair(name) else [1, 0, 0, 0]
    curve = made(name, turns=turns)
    q = curve.evaluate(np.linspace(*curve.domain, 4001))[0]
    assert angle(q[1:], q[:-1]).sum() > 2.0 * np.pi


def test_turns_are_refused_by_a_family_that_has_none():
    with pytest.raises(ValueError, match="cannot make whole turns"):
        made("squad", turns=[1, 0, 0, 0])
    with pytest.raises(ValueError, match="turns must be a list of 4 whole numbers"):
        made("c2_cumulative", start_velocity=[0, 0, 0], turns=[1, 0])


def test_names_of_a_familys_own_go_with_the_common_ones():
    ends = {"q0": TURNS[0], "q1": TURNS[1], "t0": 1.0, "t1": 3.0}
    given = {"omega0": [0, 0, 1.0], "omega1": [0, 1.0, 0]}
    common = {"start_velocity": [0, 0, 1.0], "end_velocity": [0, 1.0, 0]}
    family = METHODS["kks_hermite"]
    times = np.linspace(1.0, 3.0, 11)
    own, shared = family(**ends, **given), family(**ends, **common)
    assert shared.evaluate(times)[0] == pytest.approx(own.evaluate(times)[0], abs=1e-15)


def test_vectors_of_own_names_are_in_the_frame_that_is_said_beside_keyframes():
    given = {"omega0": [1, 0, 0.5], "omega1": [0, 1, 0], "alpha0": [1, 2, 3], "alpha1": [3, 2, 1]}
    family, keys = METHODS["kks_quintic_hermite"], TURNS[1:3]
    own = family(q0=keys[0], q1=keys[1], frame="world", **given).ends()
    for said in ("frame", "velocity_frame"):
        ends = family(keys=keys, times=[0, 1], **{said: "world"}, **given).ends()
        assert np.concatenate(ends, axis=1) == pytest.approx(np.concatenate(own, axis=1), abs=1e-12)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("kks_hermite", {"t1": 9.0}),
        ("kks_hermite", {"start_velocity": [0, 0, 1], "omega0": [0, 0, 2]}),
        ("kks_hermite", {"velocity_frame": "body", "frame": "world"}),
        ("kks_hermite", {"turns": 1, "revolutions": 2}),
        ("c2_cumulative", {"end_velocity": [0, 0, 1], "omega_end": [0, 0, 2]}),
        ("kks_bspline", {"control": TURNS}),
    ],
)
def test_what_is_said_by_two_names_is_refused(name, given):
    with pytest.raises(TypeError, match=f"{name} must be given .* got both"):
        made(name, **given)


def test_orientations_may_be_of_any_kind():
    q = TURNS.as_quat()
    kinds = (
        TURNS,
        list(TURNS),
        q[:, [3, 0, 1, 2]],
        Quaternion.from_array(q, order="xyzw"),
        Quaternion.from_array(q[:, [3, 0, 1, 2]], order="wxyz"),
    )
    curves = [METHODS["squad"](keys=kind, times=[0, 1, 2, 3, 4]) for kind in kinds]
    assert all(curve == curves[0] for curve in curves)


def test_an_order_that_is_none_is_refused():
    with pytest.raises(ValueError, match="order must be 'wxyz' or 'xyzw', got 'xwyz'"):
        Quaternion.from_array([1, 0, 0, 0], order="xwyz")
    with pytest.raises(ValueError, match="shape"):
        Quaternion.from_array([1, 0, 0], order="wxyz")


@pytest.mark.parametrize("name", METHODS)
def test_a_family_declares_the_parameters_that_its_constructor_takes(name):
    assert METHODS[name].takes == tuple(signature(METHODS[name]).parameters)


def test_an_error_says_which_parameter_is_wrong():
    with pytest.raises(ParameterError, match="rule must be one of") as caught:
        made("squad", rule="parable")
    assert caught.value.parameter == "rule"
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.parameter, str(again)) == ("rule", str(caught.value))


def test_a_misspelt_parameter_is_refused():
    with pytest.raises(TypeError, match="velocty"):
        made("squad", start_velocty=[0, 0, 1])


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_every_curve_is_pickled_and_equal_to_what_comes_back(path):
    case = json.loads(path.read_text())
    curve = METHODS[case["family"]](**case["params"])
    back = pickle.loads(pickle.dumps(curve))
    assert back == curve
    assert hash(back) == hash(curve)
    times = np.linspace(*curve.domain, 50)
    for ours, theirs in zip(back.evaluate(times), curve.evaluate(times), strict=True):
        assert np.array_equal(ours, theirs)


@pytest.mark.parametrize("name", METHODS)
def test_every_family_is_pickled_compared_and_shown(name):
    curve = made(name)
    assert pickle.loads(pickle.dumps(curve)) == curve == made(name)
    assert curve != made(name, times=2.0 + np.arange(2.0 if is_pair(name) else 5.0))
    assert curve != "a curve"
    assert type(curve).__name__ in repr(curve)
    assert "1 s to" in repr(curve)
    assert len(repr(curve)) < 500


def test_what_a_curve_was_made_of_is_its_own():
    keys, times = TURNS.as_quat()[:, [3, 0, 1, 2]], np.arange(5.0)
    curve, same = (METHODS["squad"](keys=keys, times=times) for _ in range(2))
    keys[2] = conjugate(keys[2])
    assert curve == same
    with pytest.raises(ValueError, match="read-only"):
        curve.made_of["keys"][0] = 0.0


PROGRAM = """
import sys, time
import numpy, scipy, scipy.spatial.transform
before = set(sys.modules)
begin = time.process_time()
import orientd.curves
taken = time.process_time() - begin
import orientd
orientd.curves.METHODS["c2_cumulative"]
names = {name.split(".")[0] for name in set(sys.modules) - before}
posix = {"fcntl", "resource", "pwd", "grp", "termios", "mmap", "posix_ipc"}
others = {"grpc", "pydantic", "matplotlib", "yaml", "google"}
print(taken, sorted(names & (posix | others)))
"""


def test_importing_the_curves_is_quick_and_loads_nothing_of_the_daemon():
    for _ in range(3):
        command = [sys.executable, "-c", PROGRAM]
        found = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds, modules = found.stdout.split(maxsplit=1)
        assert modules.strip() == "[]"
        if float(seconds) < 0.15:
            break
    assert float(seconds) < 0.15


def test_a_curve_shows_its_picture_in_a_notebook(tmp_path):
    pytest.importorskip("matplotlib")
    for name in ("kks_bspline", "slerp"):
        assert plots.picture(made(name))._repr_png_().startswith(b"\x89PNG")
    plots.draw(made("squad"), tmp_path / "squad.svg")
    assert "trace-x" in (tmp_path / "squad.svg").read_text()


def test_plot_of_a_curve_names_the_function_that_draws_it(tmp_path):
    with pytest.raises(OrientdError, match=r"orientd\.plots\.draw\(curve, path\)"):
        made("squad").plot(tmp_path / "squad.svg", title="squad")
