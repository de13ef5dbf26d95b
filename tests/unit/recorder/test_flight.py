"""Recordings that the flight recorder's process writes from the shared memory."""

import io
import json
import resource
import tempfile

import numpy as np
import pytest
from recorded import RATE_HZ, moving

from orientd.daemon.device.cycle_memory import CycleMemory
from orientd.recorder import flight, reader
from orientd.recorder.writer import RecordingError
from orientd.stream.records import CYCLE_RECORD
from orientd.stream.ring import RecordRing


class Servo:
    """A ring of cycles that a servo publishes to, and the memory that keeps them."""

    def __init__(self, memory, *, capacity=4096):
        size = RecordRing.bytes_needed(CYCLE_RECORD, capacity)
        self.ring = RecordRing(memoryview(bytearray(size)), CYCLE_RECORD, capacity)
        self.memory = memory

    def publish(self, table, *, every=5):
        """Publish *table*, and have the memory look *every* so many cycles, as a thread does."""
        for row in table:
            self.ring.publish(*CYCLE_RECORD.unpack(row.tobytes())[1:])
            if self.ring.head % every == 0:
                self.memory.take(self.ring)

    def end(self):
        self.memory.take(self.ring, is_last=True)


def stream(memory, directory, *, since_ns=0, fault_ns=0, events=(), keep_files=20, keep_bytes=1e9):
    packed = [event.SerializeToString() for event in events]
    header = {
        "device": "arm", "rate_hz": RATE_HZ, "reason": "link lost", "fault_ns": fault_ns,
        "since_ns": since_ns, "offset_ns": 10**18, "layout": CYCLE_RECORD.format,
        "configuration": "{}", "directory": str(directory), "keep_files": keep_files,
        "keep_bytes": keep_bytes, "events": [len(one) for one in packed],
    }  # fmt: skip
    with tempfile.TemporaryFile() as slots:
        memory.copy_to(slots.fileno())
        slots.seek(0)
        content = slots.read()
    return io.BytesIO(b"".join([json.dumps(header).encode(), b"\n", *packed, content]))


def test_the_last_minute_is_there_without_a_gap(tmp_path):
    table = moving(3000)
    memory = CycleMemory(1000)
    servo = Servo(memory)
    servo.publish(table)
    servo.end()
    since = int(table["deadline_ns"][-900])
    path = flight.write(stream(memory, tmp_path, since_ns=since))
    cycles = reader.load_recording(path).cycles["arm"]
    np.testing.assert_array_equal(cycles["index"], np.arange(2100, 3000))


def test_a_servo_that_was_started_anew_goes_on_in_the_same_file(tmp_path):
    table = moving(700)
    memory = CycleMemory(1000)
    for part in (table[:300], table[300:]):
        servo = Servo(memory)
        part = part.copy()
        servo.publish(part)
        servo.end()
    cycles = reader.load_recording(flight.write(stream(memory, tmp_path))).cycles["arm"]
    np.testing.assert_array_equal(cycles["deadline_ns"], table["deadline_ns"])
    np.testing.assert_array_equal(cycles["index"], [*range(300), *range(400)])


def test_the_oldest_files_make_room(tmp_path):
    memory = CycleMemory(10)
    (tmp_path / "mine.mcap").write_text("not the flight recorder's")
    paths = [
        flight.write(stream(memory, tmp_path, fault_ns=k * 10**9, keep_files=2)) for k in range(4)
    ]
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "mine.mcap", *paths[2:]])
    last = flight.write(stream(memory, tmp_path, fault_ns=9 * 10**9, keep_bytes=1))
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "mine.mcap", last])


def test_nothing_is_left_of_what_cannot_be_written(tmp_path):
    memory = CycleMemory(1000)
    servo = Servo(memory)
    servo.publish(moving(1000))
    servo.end()
    handed = stream(memory, tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(RecordingError, match="File too large"):
            flight.write(handed)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
