"""Orientations in text: TUM trajectories, EuRoC tables, and what is said of times and norms."""

import json
import os
import re

import numpy as np
import pytest
from command_line import orientd

from orientd import rotation
from orientd.recorder.writer import RecordingError
from orientd_replay.orientations import read_orientations

CASES = int(os.environ.get("ORIENTD_CASES", "10"))
START_NS = 1_403_636_579_758_555_392
STEP_NS = 5_000_001
COUNT = 300
NS = STEP_NS * np.arange(COUNT)
TIMES = NS * 1e-9
Q = rotation.exp(np.outer(0.8 * np.sin(TIMES), [0.0, 0.6, 0.8]))
EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]"
)
TUM = "# timestamp tx ty tz qx qy qz qw"


def seconds(ns):
    return f"{ns // 10**9}.{ns % 10**9:09d}"


def tum(path, *, header=TUM, order="xyzw", q=Q, ns=NS, start=START_NS):
    lines = ["# ground truth trajectory", "# file: 'a.bag'", header, ""]
    for at, one in zip((start + ns).tolist(), q, strict=True):
        parts = dict(zip("wxyz", one, strict=True))
        numbers = " ".join(f"{parts[name]:.6f}" for name in order)
        lines.append(f"{seconds(at)} 1.1 -0.2 0.3 {numbers} ")
    path.write_text("\n".join(lines) + "\n")
    return path


def euroc(path, *, header=EUROC, ns=NS, q=Q):
    lines = [header]
    for at, one in zip((START_NS + ns).tolist(), q, strict=True):
        lines.append(f"{at},1.1,0.2,0.3,{','.join(f'{c:.6f}' for c in one)},0.1,0.2,0.3")
    path.write_text("\n".join(lines) + "\n")
    return path


def check(found):
    # To the nanosecond, which a double of the time of day has not.
    assert np.array_equal(np.rint(found.times * 1e9).astype(np.int64), NS)
    assert rotation.angle(found.q, Q).max() < 3e-6
    assert np.allclose(np.linalg.norm(found.q, axis=1), 1.0, rtol=0, atol=1.1e-6)


@pytest.mark.parametrize("name", ["a.tum", "a.txt"])
def test_a_tum_trajectory_is_read_to_the_nanosecond(tmp_path, name):
    found = read_orientations(tum(tmp_path / name))
    check(found)


def test_the_header_of_a_tum_trajectory_says_where_w_is(tmp_path):
    header = "#timestamp tx ty tz qw qx qy qz"
    check(read_orientations(tum(tmp_path / "a.tum", header=header, order="wxyz")))
    # Without one it is last.
    check(read_orientations(tum(tmp_path / "a.tum", header="# anything")))


@pytest.mark.parametrize("clock", ["#timestamp", "#timestamp [ns]", "timestamp"])
def test_a_table_of_euroc_is_read_to_the_nanosecond(tmp_path, clock):
    check(read_orientations(euroc(tmp_path / "a.csv", header=EUROC.replace("#timestamp", clock))))


@pytest.mark.parametrize("write", [tum, euroc])
def test_one_stamp_that_steps_back_is_named_with_its_line(tmp_path, write):
    ns = NS.copy()
    ns[100] -= 400_000_000
    path = write(tmp_path / ("a.tum" if write is tum else "a.csv"), ns=ns)
    line = 105 if write is tum else 102
    note = next(note for note in read_orientations(path).notes if "steps back" in note)
    assert note.startswith(f"the time steps back once, first in line {line}, by at most 0.395")


@pytest.mark.parametrize("offset_ns", [0, 7_000_000])
@pytest.mark.parametrize("write", [tum, euroc])
def test_a_clock_that_starts_again_is_refused_with_its_line(tmp_path, write, offset_ns):
    ns = np.concatenate([NS[:150], NS[:150] + offset_ns])
    path = write(tmp_path / ("a.tum" if write is tum else "a.csv"), ns=ns)
    line = 155 if write is tum else 152
    back = 1e-9 * (NS[149] - offset_ns)
    with pytest.raises(RecordingError) as refused:
        read_orientations(path)
    assert (
        f"the time steps back by {back:.6g} s in line {line}, from {1e-9 * NS[149]:.6g} s"
        in str(refused.value)
    )
    assert "150 of 300 samples come after that, among earlier ones" in str(refused.value)


def test_samples_that_come_a_little_late_are_put_in_order(tmp_path):
    random = np.random.default_rng(3)
    order = np.argsort(NS + random.uniform(0, 5 * STEP_NS, COUNT), kind="stable")
    found = read_orientations(euroc(tmp_path / "a.csv", ns=NS[order], q=Q[order]))
    assert any("samples are taken in the order of their times" in note for note in found.notes)


def test_a_line_that_is_cut_is_named(tmp_path):
    for path in (tum(tmp_path / "a.tum"), euroc(tmp_path / "a.csv")):
        text = path.read_text()
        path.write_text(text[: text.rstrip().rindex("0.3") - 30])
        note = read_orientations(path).notes[0]
        last = len(path.read_text().splitlines())
        problem = f"1 of {COUNT} samples without a time or number (first in line {last}: "
        assert note.startswith(f"left out: {problem}")
        assert re.search(r"\d fields under (8|11) columns\)$", note)


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.tum", "1 2 3\n", "line 1 is '1 2 3'; expected timestamp tx ty tz qx qy qz qw in each"),
        ("a.txt", "once upon a time there was no robot\n", "line 1 is 'once upon a time there was"),
        ("a.txt", "", "empty; expected timestamp tx ty tz qx qy qz qw in each line"),
        (
            "a.csv",
            "#timestamp [fortnight], q_w, q_x, q_y, q_z\n1,1,0,0,0\n",
            "expected s, ms, us, ns",
        ),
    ],
)
def test_texts_of_something_else_are_refused(tmp_path, name, text, problem):
    (tmp_path / name).write_text(text)
    with pytest.raises(RecordingError, match=problem):
        read_orientations(tmp_path / name)


@pytest.mark.parametrize(("unit", "digits"), [("s", 9), ("ms", 6), ("us", 3), ("ns", 0)])
def test_a_table_may_name_the_unit_of_its_times(tmp_path, unit, digits):
    rows = [
        f"{ns // 10**digits}.{ns % 10**digits:0{digits}d},{','.join(map(str, q))}"
        for ns, q in zip((START_NS + NS).tolist(), Q, strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join([f"time [{unit}],qw,qx,qy,qz", *rows]))
    check(read_orientations(tmp_path / "a.csv"))


def test_a_tum_trajectory_in_nanoseconds_is_read(tmp_path):
    lines = [
        f"{at} 0 0 0 {x} {y} {z} {w}"
        for at, (w, x, y, z) in zip((START_NS + NS).tolist(), Q, strict=True)
    ]
    (tmp_path / "a.tum").write_text("\n".join(lines))
    check(read_orientations(tmp_path / "a.tum"))


def test_tum_columns_may_be_named_in_any_order_and_split_by_commas(tmp_path):
    lines = ["# qx,qy,qz,qw,tx,ty,tz,timestamp"]
    for at, (w, x, y, z) in zip((START_NS + NS).tolist(), Q, strict=True):
        lines.append(f"{x},{y},{z},{w},0,0,0,{seconds(at)}")
    (tmp_path / "a.tum").write_text("\n".join(lines))
    check(read_orientations(tmp_path / "a.tum"))


def test_an_orientation_may_have_times_of_its_own(tmp_path):
    header = "time_s,qw,qx,qy,qz,head_time_s,head_w,head_x,head_y,head_z"
    rows = ["1,1,0,0,0,5,0,1,0,0", "2,1,0,0,0,7.5,0,1,0,0", "3,1,0,0,0,,0,1,0,0"]
    rows += [f"{k},1,0,0,0,{k + 6},0,1,0,0" for k in range(4, 12)]
    (tmp_path / "a.csv").write_text("\n".join([header, *rows, "", ""]))
    assert read_orientations(tmp_path / "a.csv").times.tolist() == list(range(11))
    found = read_orientations(tmp_path / "a.csv", "head")
    np.testing.assert_array_equal(found.times, [0.0, 2.5, np.nan, *range(5, 13)])
    assert found.notes[0].endswith("(first in line 4: '' under 'head_time_s', expected a number)")


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("1,1,0,0," + "0" * 2**20, "a row of more than 1048576 characters"),
        ("1,1,0,0," + '"\n",' * 2**19, "line 2 has a quote that another line closes"),
    ],
)
def test_a_row_beyond_all_measure_is_refused(tmp_path, row, problem):
    (tmp_path / "a.csv").write_text(f"time,qw,qx,qy,qz\n{row}\n")
    with pytest.raises(RecordingError, match=problem):
        read_orientations(tmp_path / "a.csv")


def test_many_rows_are_no_long_row(tmp_path):
    rows = [f"{k},1,0,0,{'0' * 4000}" for k in range(300)]
    (tmp_path / "a.csv").write_text("\n".join(["time,qw,qx,qy,qz", *rows]))
    assert len(read_orientations(tmp_path / "a.csv").times) == 300
    lines = [f"{k} 0 0 0 0 0 {'0' * 4000} 1" for k in range(300)]
    (tmp_path / "a.tum").write_text("\n".join(lines))
    assert len(read_orientations(tmp_path / "a.tum").times) == 300


@pytest.mark.parametrize("number", ["", "nan", "inf", "x", "1e400", "0.7e30900000001"])
def test_a_word_that_is_no_number_leaves_its_sample_out(tmp_path, number):
    rows = ["0,1,0,0,0", f"1,1,{number},0,0", f"{number},1,0,0,0"]
    rows += [f"{k},1,0,0,0" for k in range(3, 20)]
    (tmp_path / "a.csv").write_text("\n".join(["t,qw,qx,qy,qz", *rows]))
    found = read_orientations(tmp_path / "a.csv")
    np.testing.assert_allclose(found.times, [0.0, 1.0, np.nan, *range(3, 20)], atol=1e-9)
    assert np.flatnonzero(np.isnan(found.q).any(axis=1)).tolist() == [1]
    words = f"(first in line 3: {number!r} under 'qx', expected a number)"
    assert f"left out: 2 of 20 samples without a time or number {words}" in found.notes


def test_random_cuts_and_letters_never_end_in_a_trace(tmp_path):
    random = np.random.default_rng(8)
    for number in range(CASES):
        path = (tum, euroc)[number % 2](tmp_path / ("a.tum", "a.csv")[number % 2])
        content = bytearray(path.read_bytes())
        for place in random.integers(0, len(content), 5).tolist():
            content[place] = int(random.integers(256))
        path.write_bytes(content[: int(random.integers(1, len(content)))])
        try:
            found = read_orientations(path)
        except RecordingError as error:
            words = str(error)
        else:
            words = " ".join(found.notes)
            assert len(found.times) == len(found.q)
        assert "\n" not in words


@pytest.mark.parametrize("write", [tum, euroc])
def test_replay_and_plot_take_both(tmp_path, write):
    path = write(tmp_path / ("a.tum" if write is tum else "a.csv"))
    done = orientd("replay", path, "--dry-run", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["fit"]["samples"] == COUNT
    done = orientd("plot", path, "-o", tmp_path / "a.svg")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def table(path, *, delimiter=",", point=".", heading="time_s,qw,qx,qy,qz", before="", code="utf-8"):
    rows = [
        delimiter.join(f"{number:.9f}".replace(".", point) for number in (t, *q))
        for t, q in zip(TIMES, Q, strict=True)
    ]
    text = "\n".join([before + heading.replace(",", delimiter), *rows, ""])
    path.write_bytes(text.encode(code))
    return path


@pytest.mark.parametrize(
    "form",
    [
        {"delimiter": ";"},
        {"delimiter": ";", "point": ","},
        {"delimiter": "\t"},
        {"delimiter": "\t", "point": ","},
        {"delimiter": " "},
        {"delimiter": "  "},
        {"delimiter": ", "},
        {"before": "# a comment, of the time of day\n\n% another; one\n"},
        {"before": "# "},
        {"before": "# ", "delimiter": " "},
        {"before": "% ", "delimiter": ";", "point": ","},
        {"heading": "Time,qw,qx,qy,qz"},
        {"heading": "Time (s),qw,qx,qy,qz"},
        {"heading": "time,qw,qx,qy,qz,"},
        {"heading": '"time_s","qw","qx","qy","qz"'},
        {"code": "utf-16"},
        {"code": "utf-16-le"},
        {"code": "utf-16-be"},
        {"code": "utf-8-sig"},
        {"code": "utf-32"},
    ],
)
def test_a_table_in_another_dialect_is_read(tmp_path, form):
    found = read_orientations(table(tmp_path / "a.csv", **form))
    check(found)
    assert found.notes == () or "scaled to 1" in found.notes[0]


def test_a_name_in_another_encoding_does_no_harm(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{k},1,0,0,0,2\n" for k in range(20))
    path.write_bytes(f"time,qw,qx,qy,qz,temperature in \N{DEGREE SIGN}C\n{rows}".encode("latin-1"))
    assert len(read_orientations(path).times) == 20


def test_the_output_of_rostopic_is_read_by_the_stamps(tmp_path):
    names = "%time,field.header.seq,field.header.stamp,field.header.frame_id"
    names += "".join(f",field.pose.orientation.{axis}" for axis in "xyzw")
    rows = [
        f"{START_NS + ns + 7_000_000 + k % 3},{k},{START_NS + ns},map,{x},{y},{z},{w}"
        for k, (ns, (w, x, y, z)) in enumerate(zip(NS.tolist(), Q, strict=True))
    ]
    (tmp_path / "a.csv").write_text("\n".join([names, *rows]))
    found = read_orientations(tmp_path / "a.csv")
    check(found)
    assert found.clock == "the times in 'field.header.stamp'"
    # A message without a header has the time of arrival alone.
    text = (tmp_path / "a.csv").read_text().replace("field.header.stamp", "field.number")
    (tmp_path / "a.csv").write_text(text)
    found = read_orientations(tmp_path / "a.csv")
    assert found.clock == "the times in 'time'"
    assert np.abs(found.times - TIMES).max() < 1e-7


@pytest.mark.parametrize(("field", "count"), [(",0", 6), ("", 4)])
def test_a_row_that_does_not_fit_the_columns_is_named_with_its_line(tmp_path, field, count):
    path = table(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    lines[7] = lines[7] + field if field else lines[7].rpartition(",")[0]
    path.write_text("\n".join(lines))
    found = read_orientations(path)
    assert np.flatnonzero(np.isnan(found.q).any(axis=1)).tolist() == [6]
    assert f"(first in line 8: {count} fields under 5 columns)" in found.notes[0]


def test_rows_that_all_have_a_field_too_many_are_refused(tmp_path):
    path = table(tmp_path / "a.csv", point=",")
    with pytest.raises(RecordingError, match=r"300 of 300 .*first in line 2: 10 fields under 5"):
        read_orientations(path)


def test_empty_fields_at_the_end_of_each_row_do_no_harm(tmp_path):
    path = table(tmp_path / "a.csv")
    heading, *rows = path.read_text().splitlines()
    path.write_text("\n".join([heading, *(f"{row},," for row in rows)]))
    check(read_orientations(path))


def test_comments_between_the_rows_are_no_rows(tmp_path):
    path = table(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    lines[5:5] = ["# the second take", "% of two"]
    path.write_text("\n".join(lines))
    check(read_orientations(path))


def test_the_unit_of_times_may_be_in_the_name(tmp_path):
    for name, per_second in (("time_ms", 1e3), ("time_us", 1e6), ("t (ms)", 1e3), ("t [us]", 1e6)):
        rows = [f"{t * per_second:.3f},1,0,0,0" for t in (0.0, 0.5, 1.25)]
        (tmp_path / "a.csv").write_text("\n".join([f"{name},qw,qx,qy,qz", *rows]))
        np.testing.assert_allclose(read_orientations(tmp_path / "a.csv").times, [0.0, 0.5, 1.25])


def test_rows_that_are_seconds_apart_have_a_note_on_the_unit(tmp_path):
    rows = [f"{10 * k},1,0,0,0" for k in range(20)]
    (tmp_path / "a.csv").write_text("\n".join(["time,qw,qx,qy,qz", *rows]))
    (note,) = read_orientations(tmp_path / "a.csv").notes
    assert note.startswith("rows are 10 s apart; if the times are not in seconds, name their unit")
    (tmp_path / "a.csv").write_text("\n".join(["time [ms],qw,qx,qy,qz", *rows]))
    assert read_orientations(tmp_path / "a.csv").notes == ()
