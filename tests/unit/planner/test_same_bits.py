"""The same requests give the same bits, in whichever process and order they are planned."""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bits import FAMILIES, PERIOD

from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import exp

PROGRAM = Path(__file__).with_name("bits.py")


# One request of every family; number 12 takes as long as all others.
FEW = [37 if number == 12 else number for number in range(len(FAMILIES))]


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "tried",
    [
        pytest.param(FEW, id="few"),
        pytest.param(range(300), id="many", marks=[pytest.mark.slow, pytest.mark.timeout(3000)]),
    ],
)
def test_two_processes_plan_the_same_bits_in_another_order(tried):
    numbers = [str(number) for number in tried]
    orders = numbers, random.Random(len(numbers)).sample(numbers, len(numbers))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    processes = [
        subprocess.Popen(
            [sys.executable, PROGRAM, *order], stdout=subprocess.PIPE, text=True, env=environment
        )
        for order in orders
    ]
    try:
        one, other = (json.loads(process.communicate()[0]) for process in processes)
    finally:
        for process in processes:
            process.kill()
    differing = [number for number in numbers if one[number] != other[number]]
    assert not differing, {number: (one[number], other[number]) for number in differing[:3]}
    motions = {int(number) % len(FAMILIES) for number in numbers if len(one[number]) > 1}
    assert len(motions) > 0.6 * len(FAMILIES), "hardly anything could be planned"


def test_equal_limits_give_equal_motions():
    keys = [tuple(exp(np.array([0.0, 0.0, angle]))) for angle in (0.0, 0.3, -0.2, 0.5)]
    request, start = MotionRequest([Keyframe(q) for q in keys]), State.at_rest(keys[0])

    def planned():
        limits = Limits(2.375, 16.25, 7777.0, 1.0, 10.0)  # of no other test
        motion = plan(request, start=start, limits=limits, period=PERIOD)
        return motion.records(0, motion.record_count).tobytes()

    assert planned() == planned()
