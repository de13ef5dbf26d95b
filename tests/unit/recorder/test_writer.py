"""Recordings as others see them: the reader of the MCAP project, by the schemas in the file."""

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded import OFFSET_NS, RATE_HZ, decoded, moving, validated

from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd.recorder import reader
from orientd.recorder.cycle_table import QUANTA
from orientd.recorder.recording_pb2 import Scalars
from orientd.recorder.writer import (
    BLOCK,
    LIVE_CHUNK_BYTES,
    RecordingError,
    RecordingWriter,
)
from orientd.stream import CycleFlag


def write(path, table, *, events=(), **options):
    with RecordingWriter(path, offset_ns=OFFSET_NS, **options) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration('{"devices": {}}', {})
        for event in events:
            writer.add_event(event)
        for begin in range(0, len(table), BLOCK):
            writer.add_cycles("arm", table[begin : begin + BLOCK])
    return path


def check_validates(path, seconds):
    """Check that every message decodes by the schema in the file, and that none is missing."""
    counts = validated(path)
    assert counts.pop("/arm/cycles") == seconds * RATE_HZ
    assert set(counts.values()) == {25 * seconds}
    assert {topic.split("/")[2] for topic in counts} == {"sent", "measured"}


@pytest.fixture(scope="module")
def table():
    return moving(3000, joints=2)


@pytest.fixture(scope="module")
def path(table, tmp_path_factory):
    return write(tmp_path_factory.mktemp("recording") / "a.mcap", table)


def test_every_message_decodes_by_the_schema_in_the_file(path):
    check_validates(path, 6)


def test_what_was_measured_has_the_time_at_which_it_was_measured(path, table):
    shown = [content for topic, *_, content in decoded(path) if topic == "/arm/measured/pose"]
    stamps = [pose.timestamp.seconds * 10**9 + pose.timestamp.nanos for pose in shown]
    assert stamps == (table["feedback_time_ns"][::20] + OFFSET_NS).tolist()


def test_sent_and_measured_are_apart_by_topic_and_frame(path, table):
    for which in ("sent", "measured"):
        shown = [content for topic, *_, content in decoded(path) if topic == f"/arm/{which}/tf"]
        assert {message.child_frame_id for message in shown} == {f"arm/{which}"}
        q = [[getattr(m.rotation, name) for name in "wxyz"] for m in shown]
        np.testing.assert_allclose(q, table[f"{which}_q"][::20], atol=1e-7)


def test_axis_angles_are_shown_of_the_axes_that_are_there(path, table):
    shown = [content for topic, *_, content in decoded(path) if topic == "/arm/measured/joints"]
    angles = [[joint.position for joint in states.joints] for states in shown]
    np.testing.assert_allclose(angles, table["measured_joints"][::20, :2], atol=1e-7)


def test_a_recording_gives_back_the_cycles(path, table):
    recording = reader.load_recording(path)
    assert recording.is_complete
    assert recording.rate_hz("arm") == RATE_HZ
    back = recording.cycles["arm"]
    for name, quantum in QUANTA.items():
        np.testing.assert_allclose(back[name], table[name], rtol=0, atol=0.501 * quantum)


def test_a_recording_without_its_end_gives_back_what_is_there(tmp_path):
    cut = tmp_path / "cut.mcap"
    small = write(tmp_path / "small.mcap", moving(10_000))
    whole = small.read_bytes()
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    with pytest.raises(RecordingError, match="is not whole"):
        reader.load_recording(cut)
    recording = reader.load_recording(cut, partial=True)
    assert not recording.is_complete
    assert 0 < len(recording.cycles["arm"]) < 10_000


def test_events_are_kept_and_said_in_the_log(tmp_path):
    event = pb.Event(
        device="arm", kind=pb.EVENT_KIND_FAULT, motion_number=3, text="link lost", time_ns=5
    )
    path = write(tmp_path / "a.mcap", moving(10), events=[event])
    assert reader.load_recording(path).events == [event]
    (log,) = [content for topic, *_, content in decoded(path) if topic == "/log"]
    assert log.message == "fault 3: link lost"
    assert log.level == 4


def test_other_files_are_refused_in_one_line(tmp_path):
    (tmp_path / "a.mcap").write_text("no recording at all, but some text")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        reader.load_recording(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="No such file"):
        reader.load_recording(tmp_path / "b.mcap")


_FILL = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from recorded import moving
from orientd.recorder.writer import RecordingError, RecordingWriter
writer = RecordingWriter(Path(sys.argv[1]), offset_ns=0)
writer.add_device("arm", 500.0)
try:
    while True:
        writer.add_cycles("arm", moving(256))
except RecordingError as error:
    print(error)
writer.close()
"""


def test_a_full_disk_ends_the_recording_with_one_line(tmp_path):
    path, most = tmp_path / "a.mcap", 300_000

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    here = str(Path(__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", _FILL, str(path), here],
        preexec_fn=limited, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    assert line.endswith("File too large")
    assert path.stat().st_size <= most
    with pytest.raises(RecordingError, match="it has no end"):
        reader.load_recording(path)
    assert (
        reader.load_recording(path, partial=True).facts == {}
    )  # it holds cycles, but this writer was told nothing of a daemon


@pytest.mark.slow
def test_ten_minutes_validate(tmp_path):
    table = moving(300_000, joints=6)
    path = write(tmp_path / "a.mcap", table)
    check_validates(path, 600)
    assert path.stat().st_size < 10 * 2_000_000
    np.testing.assert_array_equal(
        reader.load_recording(path).cycles["arm"]["index"], table["index"]
    )


def test_every_cycle_is_there_in_plain_numbers_where_they_are_asked_for(table, tmp_path):
    blind = table[:300].copy()
    blind["flags"][100:] = CycleFlag.WRITTEN
    path = write(tmp_path / "a.mcap", blind, has_scalars=True)
    found = [(time, told) for topic, _, time, told in decoded(path) if topic == "/arm/scalars"]
    assert [time for time, _ in found] == (blind["deadline_ns"] + OFFSET_NS).tolist()
    told = [one for _, one in found]
    for name, quantity, scale in (
        ("omega", "sent_omega_body", 1.0), ("alpha", "sent_alpha_body", 1.0), ("q", "sent_q", 1.0),
    ):  # fmt: skip
        axes = "wxyz" if name == "q" else [f"_{axis}" for axis in "xyz"]
        rows = [[getattr(one.sent, f"{name}{axis}") for axis in axes] for one in told]
        np.testing.assert_array_equal(rows, blind[quantity] * scale)
    speeds = [one.sent.speed for one in told]
    np.testing.assert_allclose(speeds, np.linalg.norm(blind["sent_omega_body"], axis=1), rtol=1e-15)
    np.testing.assert_allclose([one.lateness for one in told], blind["lateness_ns"] * 1e-9)
    assert [one.HasField("measured") for one in told] == 100 * [True] + 200 * [False]
    errors = rotation.angle(blind["sent_q"], blind["measured_q"])[:100]
    np.testing.assert_allclose([one.tracking_error for one in told[:100]], errors, atol=1e-12)
    q = [[getattr(one.measured, f"q{axis}") for axis in "wxyz"] for one in told[:100]]
    assert rotation.angle(np.array(q), blind["measured_q"][:100]).max() < 1e-12
    ages = [one.measured.age for one in told[:100]]
    behind = (blind["deadline_ns"] - blind["feedback_time_ns"])[:100] * 1e-9
    np.testing.assert_allclose(ages, behind, rtol=1e-12)


@pytest.mark.parametrize("step", [1, 5, 20], ids=["500 Hz", "100 Hz", "25 Hz"])
def test_what_is_recorded_live_is_in_the_file_within_a_second(table, tmp_path, step):
    cycles, path = table[::step], tmp_path / "a.mcap"
    at_a_time = max(1, 50 // step)
    with RecordingWriter(path, offset_ns=OFFSET_NS, chunk_bytes=LIVE_CHUNK_BYTES) as writer:
        writer.add_device("arm", RATE_HZ / step)
        writer.add_configuration('{"devices": {}}', {})
        for begin in range(0, len(cycles), at_a_time):
            writer.add_cycles("arm", cycles[begin : begin + at_a_time])
            newest = cycles["deadline_ns"][begin : begin + at_a_time][-1]
            if begin * step % 500 == 0 and begin * step >= 1000:
                there = reader.load_recording(path, partial=True).cycles["arm"]
                # Beside this, cycles are held for up to 0.4 s before they are handed to the writer.
                assert newest - there["deadline_ns"][-1] < 0.55e9


def test_the_layout_for_foxglove_plots_what_is_in_a_recording():
    layout = json.loads((Path(__file__).parents[3] / "config" / "foxglove-layout.json").read_text())
    plots = [one for name, one in layout["configById"].items() if name.startswith("Plot!")]
    paths = [path["value"] for one in plots for path in one["paths"]]
    assert len(paths) > 10
    for path in paths:
        topic, *names = path.split(".")
        assert topic == "/arm/scalars"
        of = Scalars.DESCRIPTOR
        for name in names:
            of = of.fields_by_name[name].message_type or of.fields_by_name[name]
        assert of.type == of.TYPE_DOUBLE
