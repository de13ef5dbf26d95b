"""What outlives a loss of power: files as a disk keeps them that loses all that was not synced."""

import gc
import json
import math
import threading
import time

import pytest
from reference.disk import Disk

from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.structured_text import write_structured
from orientd_dynamixel.options import parse
from orientd_dynamixel.servo import Servo
from orientd_dynamixel.turns import Turns

BEFORE = b"before"


def until(condition):
    ends = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.0005)


@pytest.fixture
def disk(tmp_path, monkeypatch):
    return Disk(monkeypatch, tmp_path)


def taught(path):
    write_structured(path, {"keyframes": [{"quaternion": [1.0, 0.0, 0.0, 0.0]}]})


def planned(path):
    keyframes = [Keyframe((1.0, 0.0, 0.0, 0.0)), Keyframe((0.0, 1.0, 0.0, 0.0))]
    start = State.at_rest(keyframes[0].q)
    plan(MotionRequest(keyframes), start=start, limits=DEFAULT_LIMITS, period=0.01).save(path)


def recorded(path):
    writer = pytest.importorskip("orientd.recorder.writer")
    with writer.RecordingWriter(path, offset_ns=0) as recording:
        recording.add_configuration("{}", {})


@pytest.mark.parametrize(
    ("write", "name"), [(taught, "taught.yaml"), (planned, "plan.npz"), (recorded, "a.mcap")]
)
def test_a_file_is_on_the_disk_once_it_is_written(disk, tmp_path, write, name):
    write(tmp_path / name)
    assert disk.after_power_cut() == {name: (tmp_path / name).read_bytes()}


@pytest.mark.parametrize(("write", "name"), [(taught, "taught.yaml"), (planned, "plan.npz")])
def test_a_file_that_is_replaced_is_the_old_one_or_the_new_one(disk, tmp_path, write, name):
    (tmp_path / name).write_bytes(BEFORE)
    disk.keep_all()
    write(tmp_path / name)
    after = (tmp_path / name).read_bytes()
    contents = [left[name] for left in disk.seen]
    assert contents == sorted(contents, key=[BEFORE, after].index)
    assert (contents[0], contents[-1]) == (BEFORE, after)


def test_a_recording_of_the_flight_recorder_is_on_the_disk_once_it_is_reported(disk, tmp_path):
    flight = pytest.importorskip("orientd.recorder.flight")
    header = {
        "device": "arm", "rate_hz": 500.0, "reason": "link lost", "fault_ns": 10**9,
        "since_ns": 0, "offset_ns": 0, "layout": flight.CYCLE_RECORD.format,
        "configuration": "{}", "directory": str(tmp_path), "keep_files": 3, "keep_bytes": 10**9,
        "events": [],
    }  # fmt: skip
    slots = tmp_path.parent / "slots"
    slots.write_bytes(json.dumps(header).encode() + b"\n")
    with slots.open("rb") as stream:
        path = flight.write(stream)
    assert disk.after_power_cut() == {path.name: path.read_bytes()}


def turns_of(path):
    """Return the turns of a gimbal, and the servo of its first axis."""
    axes = [{"id": k, "limits_deg": [-3600, 3600]} for k in (1, 2)]
    options = parse({"port": "none", "order": "ZY", "axes": axes, "turns_file": str(path)})
    servos = [Servo(axis) for axis in options.axes]
    turns = Turns(options, servos)
    turns.open()
    return turns, servos[0]


@pytest.mark.parametrize("step_deg", [2.0, 7.0, -30.0])
def test_the_turns_on_the_disk_are_never_farther_behind_than_an_axis_may_be(
    disk, tmp_path, step_deg
):
    turns, servo = turns_of(tmp_path / "turns")
    turns.resolve(0, 0, has_kept_power=True)
    turns.resolve(1, 0, has_kept_power=True)

    def behind():
        left = tmp_path.parent / f"{tmp_path.name}-left"
        left.write_bytes(disk.after_power_cut()["turns"])
        other, _ = turns_of(left)
        other.close()
        found = other.last(0)
        return math.inf if found is None else abs(position - found)

    step = step_deg / 360.0 * servo.per_turn
    for k in range(1, math.ceil(1.2 * servo.per_turn / abs(step))):
        position = round(k * step)
        turns.note(0, position)
        # The disk takes its time; a real axis turns little meanwhile.
        until(lambda: behind() <= servo.near // 2)
    turns.close()
    assert behind() == 0


def test_an_axis_that_stands_still_costs_the_disk_nothing(disk, tmp_path):
    turns, _ = turns_of(tmp_path / "turns")
    turns.resolve(0, 0, has_kept_power=True)
    until(lambda: any(disk.after_power_cut()["turns"]))
    before = len(disk.seen)
    for k in range(1000):
        turns.note(0, k % 3)
    time.sleep(0.05)
    assert len(disk.seen) == before
    turns.close()


def test_turns_that_nobody_closes_leave_no_thread(tmp_path):
    before = set(threading.enumerate())
    turns, _ = turns_of(tmp_path / "turns")
    (thread,) = set(threading.enumerate()) - before
    del turns
    gc.collect()
    until(lambda: not thread.is_alive())
