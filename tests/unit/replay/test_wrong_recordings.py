"""Wrong recordings: each is refused in one line with place, value, expectation and next step."""

import gzip
import math
import zipfile

import pytest
from command_line import inside

HEADING = "time_s,qw,qx,qy,qz"
DESCRIPTION = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  duration: {nanoseconds: 1}
  starting_time: {nanoseconds_since_epoch: 1}
  message_count: 1
  topics_with_message_count: []
  compression_format: ""
  compression_mode: ""
  relative_file_paths: [part_0.db3]
  files: []
"""


def rows(count=100):
    """Return rows of a turn to and fro about z, 10 ms apart."""
    halves = [0.1 * math.sin(0.02 * k) for k in range(count)]
    return [f"{0.01 * k:.2f},{math.cos(a)},0,0,{math.sin(a)}" for k, a in enumerate(halves)]


def table(path, lines, heading=HEADING):
    path.write_text("\n".join([heading, *lines]) + "\n")


def sheet(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>" * 99)


def open_quote(path):
    lines = rows()
    lines[50] = f'"{lines[50]}'
    table(path, lines)


def other_order(path):
    """The time in front of x, y, z and w, below the names of w, x, y and z."""
    lines = []
    for line in rows():
        time, w, x, y, z = line.split(",")
        lines.append(",".join([z, time, w, x, y]))
    table(path, lines)


def bag(path):
    path.mkdir()
    (path / "metadata.yaml").write_text(DESCRIPTION)


def packed(path):
    path.write_bytes(gzip.compress(b"\x89MCAP0\r\n" * 30))


def dated(path):
    lines = [line.replace(line.split(",")[0], f"2026-01-01T00:00:{k:02}Z", 1)
             for k, line in enumerate(rows(60))]  # fmt: skip
    table(path, lines)


KINDS = "expected a .mcap, .csv, .tum or .txt file, or a ROS 2 bag (its folder or a .db3 file)"

# The name of the file, what writes it, and the line behind the name.
WRONG = {
    "a log of PX4": (
        "a.ulg",
        lambda path: path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(99)),
        f"not an MCAP file; {KINDS}; it is a ULog file of PX4; export its attitude with `ulog2csv` "
        "of pyulog",
    ),
    "a log of PX4 called csv": (
        "a.csv",
        lambda path: path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(99)),
        f"no text; expected columns such as {HEADING}; it is a ULog file of PX4; export its "
        "attitude with `ulog2csv` of pyulog",
    ),
    "a bag of ROS 1": (
        "a.bag",
        lambda path: path.write_bytes(b"#ROSBAG V2.0\nE\0\0\0" + bytes(500)),
        f"not an MCAP file; {KINDS}; it is a bag of ROS 1; convert it with `rosbags-convert`",
    ),
    "an MCAP file that is packed": (
        "a.mcap",
        packed,
        f"not an MCAP file; {KINDS}; it is a file packed with gzip; unpack it with `gunzip`",
    ),
    "a spreadsheet": (
        "a.csv",
        sheet,
        f"no text; expected columns such as {HEADING}; it is a ZIP archive or spreadsheet; unpack "
        "it, or export the sheet as .csv",
    ),
    "a motion file": (
        "a.yaml",
        lambda path: path.write_text("keyframes: []"),
        f"not an MCAP file; {KINDS}; its name is that of a motion file; run it with "
        "`orientd move {path}`",
    ),
    "three rows": (
        "a.csv",
        lambda path: table(path, rows(3)),
        "a fit needs at least 8 samples, got 3; take a longer recording",
    ),
    "dates for times": (
        "a.csv",
        dated,
        "more than a tenth of the samples is unusable: 60 of 60 samples without a time or number "
        "(first in line 2: '2026-01-01T00:00:00Z' under 'time_s', expected a number); cut or "
        "repair the recording",
    ),
    "a quote that is left open": (
        "a.csv",
        open_quote,
        "line 52 has a quote that another line closes, expected each row in one line; remove the "
        "quote",
    ),
    "a column that is missing": (
        "a.csv",
        lambda path: table(path, rows(), "time_s,qw,qx,qy,q"),
        f"no quaternion in the columns time_s, qw, qx, qy, q; expected {HEADING}",
    ),
    "columns in another order": (
        "a.csv",
        other_order,
        "20 of 100 samples are outliers, expected at most a tenth: the first at 0.069 s; look at "
        "the samples there, and at the order of w, x, y, z",
    ),
    "a matrix in each line": (
        "a.txt",
        lambda path: path.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 20),
        "line 1 is '1 0 0 0 0 1 0 0 0 0 1 0'; expected timestamp tx ty tz qx qy qz qw in each line "
        "(a table with named columns ends in .csv)",
    ),
    "a Parquet file": (
        "a.parquet",
        lambda path: path.write_bytes(b"PAR1" + bytes(99)),
        f"not an MCAP file; {KINDS}; it is a Parquet file; export its quaternions as .csv",
    ),
    "seconds called nanoseconds": (
        "a.csv",
        lambda path: table(path, rows(), "time_ns,qw,qx,qy,qz"),
        "the column 'time_ns' is in ns, and rows are 0.01 ns apart; call it 'time_s' if it holds "
        "seconds",
    ),
    "half a turn from each row to the next": (
        "a.csv",
        lambda path: table(path, [f"{k / 50},{k % 2},0,0,{1 - k % 2}" for k in range(200)]),
        "a fit needs at least 8 samples, got 7 on one smooth motion of 200; check the columns of "
        "the quaternions, and the unit of the times",
    ),
    "a table without rows": (
        "a.csv",
        lambda path: table(path, []),
        "no rows below the names of the columns; add them",
    ),
    "a bag without its part": (
        "a",
        bag,
        "not a ROS 2 bag that can be read: Some database files are missing: "
        "['{path}/part_0.db3']; copy the whole bag again, or repair it with `ros2 bag reindex`",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_recording_is_refused_with_its_place_and_the_next_step(tmp_path, name):
    file, write, line = WRONG[name]
    path = tmp_path / file
    write(path)
    done = inside("replay", path, "--dry-run")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"orientd: {path}: {line.format(path=path)}\n"


@pytest.mark.parametrize("name", ["a.csv", "a.mcap", "a.tum"])
def test_a_plan_of_a_recording_names_the_command_for_it(tmp_path, name):
    path = tmp_path / name
    table(path, rows())
    done = inside("plan", path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"orientd: {path}: a recording by its name, expected a motion file in YAML or JSON; plan "
        "it with `orientd replay --dry-run`\n"
    )
