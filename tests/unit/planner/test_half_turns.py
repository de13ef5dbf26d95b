"""A half turn goes one way: on every processor, in every form of input, for q and -q."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from half_turns import FORMS, form_of, rate, way
from motions import read

import orientd
from orientd import processor
from orientd.curves import METHODS, CurveTask, is_pair, make_curve
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.motion_file import parse
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import exp, multiply

PROGRAM = Path(__file__).with_name("half_turns.py")
CASES = int(os.environ.get("ORIENTD_CASES", "12"))
AXES = np.eye(3)
HERE = np.array([1.0, 0.0, 0.0, 0.0])


def about(axis, degrees):
    return exp(math.radians(degrees) * AXES["xyz".index(axis)])


@pytest.mark.parametrize("form", ["euler", *FORMS])
@pytest.mark.parametrize("axis", "xyz")
def test_half_turns_about_an_axis_go_the_positive_way_in_every_form(axis, form):
    found = []
    for degrees in range(0, 360, 15):
        if form == "euler":
            pair = [
                {"euler": {"axes": axis, "degrees": [angle]}} for angle in (degrees, degrees + 180)
            ]
        else:
            pair = [form_of(about(axis, angle), form) for angle in (degrees, degrees + 180)]
        found.append(way(pair, AXES["xyz".index(axis)]))
    assert found == [1.0] * 24


def test_the_way_does_not_depend_on_processor_form_sign_or_place():
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    levels = {
        level: subprocess.Popen(
            [sys.executable, PROGRAM, str(CASES)],
            stdout=subprocess.PIPE,
            env={**environment, processor.FORCED: level},
        )
        for level in processor.runnable()
    }
    try:
        found = {level: json.loads(process.communicate()[0]) for level, process in levels.items()}
    finally:
        for process in levels.values():
            process.kill()
            process.wait()
    for number in range(CASES):
        went = {way for of_level in found.values() for way in of_level[number]}
        assert len(went) == 1, (number, {level: of[number] for level, of in found.items()})
        assert went <= {1.0, -1.0}


@pytest.mark.parametrize("name", METHODS)
def test_every_family_goes_the_same_way_for_q_and_minus_q(name):
    random, family = np.random.default_rng(5), METHODS[name]
    for _ in range(10):
        axis = random.normal(size=3)
        axis *= np.sign(axis[2]) / np.linalg.norm(axis)
        q = random.normal(size=4)
        steps = [math.pi * axis] if is_pair(family) else [0.3 * axis, math.pi * axis, 0.3 * axis]
        keys = [q / np.linalg.norm(q)]
        for step in steps:
            keys.append(multiply(keys[-1], exp(step)))
        curves = []
        for signs in (np.ones(len(keys)), random.choice([-1.0, 1.0], len(keys))):
            given = np.array(keys) * signs[:, None]
            options = {"path": "short"} if name == "slerp" else {}
            task = CurveTask(given, np.arange(len(given), dtype=np.float64))
            curves.append(make_curve(family, task, options))
        u = np.linspace(*curves[0].domain, 9)[1:-1]
        omegas = [curve.evaluate(u)[1] for curve in curves]
        assert np.allclose(*omegas, atol=1e-6)
        assert omegas[0][3] @ axis > 0.0


def test_a_pair_that_rounding_makes_longer_goes_that_way_and_meets_its_keyframes():
    beyond = exp([0.0, 0.0, math.pi + 5e-8])
    for fields in ({}, {"method": "slerp"}, {"pace": "even"}, {"duration": 4.0}):
        pair = [form_of(q, "rotation_vector") for q in (HERE, beyond)]
        motion = orientd.plan(parse({"keyframes": pair, **fields}))
        assert rate(pair, **fields)[2] > 0.0
        assert motion.certificate.keyframe_error < 1e-12


def test_beyond_rounding_the_shorter_way_is_taken():
    for extra, sign in ((1e-6, -1.0), (-1e-6, 1.0)):
        pair = [form_of(q, "matrix") for q in (HERE, exp([0.0, 0.0, math.pi + extra]))]
        assert way(pair, AXES[2]) == sign


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("axis", "goes"), [((0.6, 0.0, -0.8), -1), ((-0.6, 0.8, 1e-9), 1), ((-1.0, 0.0, 0.0), -1)]
)
def test_a_single_keyframe_half_a_turn_from_rest_goes_the_same_way(axis, goes, sign):
    target = sign * exp(math.pi * np.array(axis) / np.linalg.norm(axis))
    limits = [{}, {"limits": {"velocity": [1.0, 2.0, 1.5]}}, {"pace": "even"}]
    for fields in [*limits, {"position": [0.1, 0.0, 0.0]}]:
        position = fields.get("position")
        others = {name: value for name, value in fields.items() if name != "position"}
        keyframe = {"quaternion": dict(zip("wxyz", target.tolist(), strict=True))}
        keyframe |= {"position": position} if position else {}
        request = read([keyframe], **others)
        start = State.at_rest(HERE)
        motion = plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002)
        omega = motion.sample(np.array([0.5 * motion.duration])).omega_body[0]
        assert goes * float(omega @ axis) > 0.0, fields


def notes(keyframes, **fields):
    return orientd.plan(parse({"keyframes": keyframes, **fields})).certificate.notes


def test_the_certificate_says_which_way_and_how_to_choose_the_other():
    pair = [{"euler": {"axes": "z", "degrees": [angle]}} for angle in (90, 270)]
    (note,) = notes(pair)
    assert note == (
        "keyframes[1] is half a turn away: turned about +z in the body frame; `turns: -1` there "
        "chooses the other way"
    )
    other = [pair[0], {**pair[1], "turns": -1}]
    assert way(other, AXES[2]) == -1.0
    assert not notes(other)
    (note,) = notes(pair, method="squad")
    assert "a keyframe on the way chooses the other way" in note
    assert not notes([pair[0], {"euler": {"axes": "z", "degrees": [269.99]}}])


def test_many_half_turns_are_counted():
    keyframes = [{"euler": {"axes": "z", "degrees": [180 * k % 360]}} for k in range(8)]
    found = notes(keyframes)
    assert len(found) == 4
    assert "4 more keyframes" in found[-1]


def test_a_half_turn_from_where_the_device_is_has_a_note():
    request = MotionRequest([Keyframe((0.0, 1.0, 0.0, 0.0))])
    motion = plan(request, start=State.at_rest(HERE), limits=DEFAULT_LIMITS, period=0.002)
    assert "turned about +x in the body frame; `turns: -1`" in motion.certificate.notes[0]
