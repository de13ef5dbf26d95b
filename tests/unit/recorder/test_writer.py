"""Recordings as others see them: the reader of the MCAP project, by the schemas in the file."""

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded import OFFSET_NS, RATE_HZ, decoded, moving, validated

from orientd.recorder import reader
from orientd.recorder.cycle_table import QUANTA
from orientd.recorder.writer import BLOCK, RecordingError, RecordingWriter
from orientd.rpc import control_pb2 as pb


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
    recording = reader.load_recording(cut)
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
    with pytest.raises(RecordingError, match="not a recording of orientd"):
        reader.load_recording(path)  # it holds cycles, but this writer was told nothing of a daemon


@pytest.mark.slow
def test_ten_minutes_validate(tmp_path):
    table = moving(300_000, joints=6)
    path = write(tmp_path / "a.mcap", table)
    check_validates(path, 600)
    assert path.stat().st_size < 10 * 2_000_000
    np.testing.assert_array_equal(
        reader.load_recording(path).cycles["arm"]["index"], table["index"]
    )
