"""Recordings as others see them: the reader of the MCAP project, by the schemas in the file."""

import json
import re
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from recorded import OFFSET_NS, RATE_HZ, decoded, moving, validated

from orientd.recorder import reader
from orientd.recorder.columns import Layout, schema
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
