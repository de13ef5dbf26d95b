"""Nonsense in the shared memory: the servo comes to rest inside the limits."""

import random

import numpy as np
import pytest
from rig import PERIOD, PERIOD_NS, TERMS, Rig, turn
from setpoint_checker import reached

from orientd.errors import Fault
from orientd.stream.records import PATH_FLOATS, PATH_RECORD, ServoState

WILD = (0, 1, 2**31, 2**63, 2**64 - 1)
FLOATS = (float("nan"), float("inf"), -1e308, 1e-310, 0.0, 3.0)
ROUNDS = 32


def scribble(memory, chance):
    """Write nonsense over one part of the memory, as a program of the same user could."""
    ring = chance.choice(
        (memory.path, memory.commands, memory.cycles, memory.notes, memory.targets, memory.chunks)
    )
    match chance.randrange(4):
        case 0:
            ring.words[chance.randrange(8)] = chance.choice(WILD)
        case 1:
            at = chance.randrange(len(ring._slots))
            junk = chance.randbytes(min(5000, len(ring._slots) - at))
            ring._slots[at : at + len(junk)] = junk
        case 2:
            # A record that is whole, of numbers that mean nothing, a little ahead.
            for index in range(memory.path.head):
                fields = [chance.choice(FLOATS) for _ in range(PATH_FLOATS)]
                memory.path.put([PATH_RECORD.pack(index, *fields)], index)
            memory.targets.publish(0, 2**62, *[chance.choice(FLOATS) for _ in range(10)])
        case _:
            memory.pulse[chance.randrange(4)] = chance.choice(WILD)


@pytest.mark.parametrize("seed", range(4))
def test_nonsense_ends_in_rest_inside_the_limits(seed):
    for number in range(ROUNDS // 4):
        chance = random.Random(f"{seed} {number}")
        rig = Rig()
        rig.start(turn())
        rig.run(chance.randrange(100, 700))
        for _ in range(chance.choice((1, 3))):
            scribble(rig.memory, chance)
        for _ in range(2000):
            # Whatever the words say now, the servo runs its cycles.
            rig.clock.advance(2_000_000)
            rig.servo.cycle(rig.clock.now_ns(), 0)
        assert not rig.servo.is_moving, (seed, number)
        sent = [(s.q, s.position) for s in rig.driver.setpoints]
        found = reached([q for q, _ in sent], [p for _, p in sent], PERIOD)
        for name, value in found.items():
            assert value <= getattr(TERMS, name) * 1.001 + 1e-9, (seed, number, name)
        rig.memory.close()


def test_a_record_that_is_no_orientation_is_not_sent():
    rig = Rig()
    first = rig.start(turn())
    rig.run(100)
    for index in range(first + 300, first + 400):
        fields = list(rig.memory.path.read(index))
        fields[1:5] = [2.0 * part for part in fields[1:5]]
        rig.memory.path.put([PATH_RECORD.pack(*fields)], index)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is Fault.PATH_STARVED
    assert "is not an orientation" in rig.servo.setpoints.fault_text
    np.testing.assert_allclose(np.linalg.norm(rig.sent(), axis=1), 1.0, atol=1e-9)


def test_a_heartbeat_from_the_future_is_none():
    rig = Rig()
    rig.start(turn())
    rig.run(100)
    rig.beats = False
    rig.memory.pulse[0] = 2**63
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is Fault.HEARTBEAT_LOST


def test_a_stall_is_no_heartbeat_from_the_future():
    rig = Rig()
    rig.start(turn())
    rig.run(100)
    began_ns = rig.clock.now_ns() + PERIOD_NS
    rig.clock.advance(5_000_000_000)
    rig.memory.beat(rig.clock.now_ns())
    rig.servo.cycle(began_ns, 0)
    assert "the servo process did not run for 5.000 s" in rig.servo.setpoints.fault_text
