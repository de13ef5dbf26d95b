"""Recordings as others see them: the reader of the MCAP project, by the schemas in the file."""

import json
import re
import resource
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from recorded import OFFSET_NS, RATE_HZ, decoded, moving, validated

from orientd.protocol import control_pb2 as pb
from orientd.recorder import reader
from orientd.recorder.columns import COLUMNS, Layout, schema
from orientd.recorder.writer import RecordingError, RecordingWriter
from orientd.stream.records import CycleFlag

ROOT = Path(__file__).parents[3]


def write(path, table, *, events=()):
    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration('{"devices": {}}', {})
        for event in events:
            writer.add_event(event)
        for begin in range(0, len(table), 250):
            writer.add_cycles("arm", table[begin : begin + 250])
    return path


def of_topic(path, wanted):
    """Return the messages of a topic, each with its log time."""
    return [(time, content) for topic, _, time, content in decoded(path) if topic == wanted]


@pytest.fixture(scope="module")
def table():
    return moving(3000, joints=2)


@pytest.fixture(scope="module")
def path(table, tmp_path_factory):
    return write(tmp_path_factory.mktemp("recording") / "a.mcap", table)


def test_every_message_decodes_by_the_schema_in_the_file(path):
    assert validated(path) == {"/arm/cycles": 3000, "/tf": 2 * 25 * 6}


def test_each_cycle_is_at_the_time_of_day_of_its_deadline(path, table):
    times = [time for time, _ in of_topic(path, "/arm/cycles")]
    assert times == (table["deadline_ns"] + OFFSET_NS).tolist()


def test_frames_show_what_was_sent_and_measured_25_times_a_second(path, table):
    shown = [frame for _, frame in of_topic(path, "/tf")]
    assert {frame.parent_frame_id for frame in shown} == {"world"}
    for which, stamps in (("sent", "deadline_ns"), ("measured", "feedback_time_ns")):
        frames = [frame for frame in shown if frame.child_frame_id == f"arm/{which}"]
        rows = table[::20]
        for part, axes, column in (
            ("rotation", "wxyz", "q"), ("translation", "xyz", "position"),
        ):  # fmt: skip
            told = [[getattr(getattr(one, part), axis) for axis in axes] for one in frames]
            np.testing.assert_array_equal(told, rows[f"{which}_{column}"])
        times = [one.timestamp.seconds * 10**9 + one.timestamp.nanos for one in frames]
        assert times == (rows[stamps] + OFFSET_NS).tolist()


def test_without_feedback_there_is_no_frame_of_what_was_measured(tmp_path):
    table = moving(40)
    table["flags"] = CycleFlag.WRITTEN
    path = write(tmp_path / "a.mcap", table)
    assert {frame.child_frame_id for _, frame in of_topic(path, "/tf")} == {"arm/sent"}


def test_a_recording_gives_back_the_cycles(path, table):
    recording = reader.load_recording(path)
    assert recording.is_complete
    assert recording.rate_hz("arm") == RATE_HZ
    back = recording.cycles["arm"]
    for one in filter(lambda column: column.name, COLUMNS):
        np.testing.assert_allclose(back[one.name], table[one.name], rtol=0, atol=0.501 * one.step)


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
    ((time_ns, log),) = of_topic(path, "/log")
    assert time_ns == OFFSET_NS + 5
    assert (log.name, log.message) == ("arm", "fault 3: link lost")
    assert log.level == 4
    assert log.timestamp.seconds * 10**9 + log.timestamp.nanos == OFFSET_NS + 5


def test_other_files_are_refused_in_one_line(tmp_path):
    (tmp_path / "a.mcap").write_text("no recording at all, but some text")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        reader.load_recording(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="No such file"):
        reader.load_recording(tmp_path / "b.mcap")


def test_a_recording_that_has_ended_takes_no_more(table, tmp_path):
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, offset_ns=OFFSET_NS)
    writer.add_device("arm", RATE_HZ)
    writer.add_configuration("{}", {})
    writer.add_cycles("arm", table[:10])
    writer.close()
    content = path.read_bytes()
    writer.close()
    for add in (lambda: writer.add_cycles("arm", table[10:]), writer.flush):
        with pytest.raises(RecordingError, match=r"a\.mcap has ended"):
            add()
    assert path.read_bytes() == content


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


_KILLED = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from recorded import moving
from orientd.recorder.writer import RecordingWriter
writer = RecordingWriter(Path(sys.argv[1]), offset_ns=0)
writer.add_device("arm", 500.0)
writer.add_configuration("{}", {})
writer.add_cycles("arm", moving(300))
writer.flush()
writer.add_cycles("arm", moving(300, first=300))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_writer_that_is_killed_leaves_a_file_that_can_be_read(tmp_path):
    path, here = tmp_path / "a.mcap", str(Path(__file__).parent)
    subprocess.run([sys.executable, "-c", _KILLED, str(path), here], check=False, timeout=60)
    with pytest.raises(RecordingError, match="it has no end"):
        reader.load_recording(path)
    assert len(reader.load_recording(path, partial=True).cycles["arm"]) == 300
    assert validated_messages(path) == 300


def validated_messages(path):
    """Return how many cycles the reader of the MCAP project finds in a file without an end."""
    from mcap.exceptions import EndOfFile
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    count, topics = 0, set()
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                if isinstance(record, Message):
                    topics.add(record.channel_id)
                    count += record.channel_id == min(topics)
        except EndOfFile:
            return count


def test_the_layout_for_foxglove_plots_what_is_in_a_recording():
    layout = json.loads((ROOT / "config" / "foxglove-layout.json").read_text())
    plots = [one for name, one in layout["configById"].items() if "paths" in one]
    paths = [path["value"] for one in plots for path in one["paths"]]
    assert len(paths) > 10
    known = Layout(schema())
    components = {"q": "wxyz", "omega_body": "xyz", "alpha_body": "xyz", "position": "xyz"}
    for path in paths:
        topic, _, name = path.partition(".")
        assert topic == "/arm/cycles"
        quantity, _, component = name.rpartition(".")
        if quantity in (known.fixed.names or ()):
            assert component in components[quantity.rpartition(".")[2]]
        else:
            assert name in (*known.fixed.names, *known.strings)


def test_the_lines_in_the_guide_read_a_recording_without_orientd(tmp_path):
    pytest.importorskip("pandas")
    page = (ROOT / "docs" / "how-to" / "read-recordings.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert blocks
    write(tmp_path / "run.mcap", moving(500, joints=2))
    for block in blocks:
        assert "orientd" not in block
        assert sum(map(bool, block.splitlines())) <= 10
        done = subprocess.run(
            [sys.executable, "-c", block],
            cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "500" in done.stdout


@pytest.mark.parametrize("joints", [0, 6])
def test_a_minute_in_motion_takes_six_megabytes_at_the_most(tmp_path, joints):
    table = moving(round(60 * RATE_HZ), joints=joints)
    size = write(tmp_path / "a.mcap", table).stat().st_size
    assert size < 6_000_000
    assert size < len(zlib.compress(table.tobytes(), 6))
