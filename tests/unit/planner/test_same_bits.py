"""The same requests give the same bits, in whichever process and order they are planned."""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from bits import FAMILIES

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
