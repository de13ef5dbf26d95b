import multiprocessing
import os
import struct
import time

import pytest

from orientd.stream.memory import SharedMemory
from orientd.stream.records import CYCLE_RECORD, NO_JOINTS, PATH_FLOATS, ServoState, unpack_cycle
from orientd.stream.ring import RecordRing

LAYOUT = struct.Struct(f"@Q{PATH_FLOATS}d")
CAPACITY = 64
RACE_SECONDS = 3.0


def ring_on(view, capacity=CAPACITY):
    return RecordRing(view, LAYOUT, capacity)


@pytest.fixture
def view():
    return memoryview(bytearray(RecordRing.bytes_needed(LAYOUT, CAPACITY)))


def test_what_was_published_is_read(view):
    ring = ring_on(view)
    ring.publish(*range(PATH_FLOATS))
    assert ring.head == 1
    assert ring.read(0) == (0, *map(float, range(PATH_FLOATS)))


def test_what_is_not_there_reads_as_none(view):
    ring = ring_on(view)
    assert ring.read(0) is None
    for _ in range(CAPACITY + 1):
        ring.publish(*range(PATH_FLOATS))
    assert ring.read(0) is None
    assert ring.read(1) is not None
    assert ring.read(CAPACITY + 1) is None


@pytest.mark.parametrize("offset", [0, 8, 71, 135])
def test_a_torn_record_reads_as_none(view, offset):
    ring = ring_on(view)
    ring.publish(*range(PATH_FLOATS))
    view[len(view) - CAPACITY * ring.stride(LAYOUT) + offset] ^= 0x40
    assert ring.read(0) is None


def write_for_seconds(descriptor, seconds):
    memory = SharedMemory(descriptor, CAPACITY, CAPACITY)
    end = time.monotonic() + seconds
    ring = memory.path
    while time.monotonic() < end:
        k = ring.head
        ring.publish(*(float(k + j) for j in range(PATH_FLOATS)))
    memory.commands.words[1] = 1
    memory.close()


def test_racing_processes_never_see_a_record_that_was_not_written():
    """One process writes as fast as it can, another reads the newest, the oldest and ahead."""
    memory = SharedMemory.create(CAPACITY, CAPACITY)
    context = multiprocessing.get_context("fork")
    writer = context.Process(
        target=write_for_seconds, args=(os.dup(memory.descriptor), RACE_SECONDS)
    )
    writer.start()
    ring, taken, refused = memory.path, 0, 0
    try:
        while not memory.commands.words[1]:
            head = ring.head
            for index in (head - 1, head - CAPACITY, head):
                if index < 0:
                    continue
                record = ring.read(index)
                if record is None:
                    refused += 1
                    continue
                assert record[0] == index
                assert record[1:] == tuple(float(index + j) for j in range(PATH_FLOATS))
                taken += 1
    finally:
        writer.join()
        memory.close()
    assert writer.exitcode == 0
    assert taken > 10_000
    assert refused > 0  # slots were caught in the making, so the race took place


def consume_in_order(descriptor, count):
    memory = SharedMemory(descriptor, CAPACITY, CAPACITY)
    path, expected = memory.path, 0
    while expected < count:
        record = path.read(expected)
        if record is None or expected >= path.head:
            continue
        if record[1:] != tuple(float(expected * j) for j in range(PATH_FLOATS)):
            os._exit(3)
        expected += 1
        path.words[2] = expected
    os._exit(0)


@pytest.mark.parametrize("count", [10_000, pytest.param(60_000, marks=pytest.mark.slow)])
def test_a_full_ring_between_two_processes_loses_nothing(count):
    memory = SharedMemory.create(CAPACITY, CAPACITY)
    context = multiprocessing.get_context("fork")
    reader = context.Process(target=consume_in_order, args=(os.dup(memory.descriptor), count))
    reader.start()
    ring = memory.path
    while ring.head < count:
        if ring.head - ring.words[2] < CAPACITY:
            k = ring.head
            ring.publish(*(float(k * j) for j in range(PATH_FLOATS)))
        elif not reader.is_alive():
            break
    reader.join()
    memory.close()
    assert reader.exitcode == 0


def test_the_memory_has_no_name_and_goes_with_its_users():
    before = set(os.listdir("/dev/shm"))
    memory = SharedMemory.create(4096, 4096)
    assert set(os.listdir("/dev/shm")) == before
    memory.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(memory.descriptor)


def test_a_cycle_survives_its_bytes():
    state, floats = ServoState.STREAMING, map(float, range(23))
    fields = (5, 100, 7, 8, 50, 9, state, 0, 3, 3, 1, 0, 0.25, 0.5, *floats)
    joints = (0.1, 0.2, 0.3, *NO_JOINTS[3:], 0.4, 0.5, *NO_JOINTS[2:])
    planned_q = (0.5, -0.5, 0.5, -0.5)
    cycle = unpack_cycle(CYCLE_RECORD.pack(*fields, *joints, *planned_q))
    assert cycle.planned_q == planned_q
    assert (cycle.joints, cycle.sent_joints) == ((0.1, 0.2, 0.3), (0.4, 0.5))
    assert cycle.state is ServoState.STREAMING
    assert cycle.q == (0.0, 1.0, 2.0, 3.0)
    assert cycle.feedback_position == (20.0, 21.0, 22.0)
    assert cycle.feedback_age_ns == 50
    assert cycle.path_fraction == 0.25
