"""Tables of directions: how exact they are, and the lines that refuse wrong ones."""

import math
import re

import numpy as np
import pytest
from command_line import inside

from orientd.errors import OrientdError
from orientd_rotctld.ephemeris import MOST_ERROR, from_table

NOW = 1.8e9


def orbit(since, top, height=500.0):
    """Return unit vectors of a target *height* km high that culminates at *top* degrees at time 0.

    The earth is a sphere that does not turn, and the orbit a circle.
    """
    earth = 6378.0
    radius, elevation = earth + height, math.radians(top)
    aside = math.acos(earth / radius * math.cos(elevation)) - elevation
    along = math.sqrt(398600.4 / radius**3) * np.asarray(since)
    up = radius * math.cos(aside) * np.cos(along) - earth
    north = radius * math.sin(aside) * np.cos(along)
    away = np.stack([north, -radius * np.sin(along), up], axis=-1)
    return away / np.linalg.norm(away, axis=-1, keepdims=True)


def half_pass(top, height=500.0):
    """Return the time from the rise to the culmination, s."""
    since = np.arange(0.0, 4000.0)
    return float(since[np.argmax(orbit(since, top, height)[:, 2] < 0.0)])


def angles(points):
    """Return azimuths and elevations, degrees."""
    x, y, z = points.T
    return np.degrees(np.arctan2(-y, x)) % 360.0, np.degrees(np.arcsin(z))


def vectors(azimuth, elevation):
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), -level * np.sin(azimuth), np.sin(elevation)], -1)


def written(folder, since, azimuth, elevation, digits=4):
    rows = zip(NOW + np.asarray(since), azimuth, elevation, strict=True)
    table = folder / "pass.csv"
    table.write_text(
        "time,azimuth,elevation\n"
        + "".join(f"{t:.3f},{a:.{digits}f},{e:.{digits}f}\n" for t, a, e in rows)
    )
    return table


def of_pass(folder, step, top, *, phase=0.0, height=500.0, digits=4):
    """Return the table of a pass, and the times of its rows since the culmination."""
    half = half_pass(top, height)
    since = np.arange(-half, half, step) + phase * step
    return from_table(written(folder, since, *angles(orbit(since, top, height)), digits)), since


def true_error(table, since, top):
    fine = np.linspace(since[0], since[-1], 4001)[1:-1]
    apart = np.linalg.norm(table.target.at(NOW + fine) - orbit(fine, top), axis=1)
    return math.degrees(apart.max())


@pytest.mark.parametrize(("step", "most"), [(10.0, 4.0), (30.0, 4.0), (60.0, 4.0), (120.0, 6.0)])
@pytest.mark.parametrize("top", [30.0, 60.0, 85.0])
def test_the_error_between_the_rows_of_a_pass_is_estimated_from_the_rows(tmp_path, step, most, top):
    for phase in np.linspace(0.0, 1.0, 5, endpoint=False):
        table, since = of_pass(tmp_path, step, top, phase=phase)
        error = true_error(table, since, top)
        # The angles of the file have four digits, which is an error of its own.
        assert 0.5 * error - 2e-4 < table.error < most * error + 2e-4


def test_a_table_says_how_exact_it_is_and_where_it_is_worst(tmp_path):
    table, since = of_pass(tmp_path, 10.0, 85.0)
    assert table.is_exact
    size, line = re.search(
        r"known to (\S+) degrees, worst near line (\d+) ", table.summary
    ).groups()
    assert float(size) == pytest.approx(table.error, rel=0.1)
    assert abs(since[int(line) - 2]) < 60.0
    assert table.summary.startswith(f"{tmp_path}/pass.csv: {len(since)} rows, a row every 10 s: ")


@pytest.mark.parametrize("step", [60.0, 90.0, 120.0])
@pytest.mark.parametrize("top", [40.0, 60.0, 85.0])
def test_rows_at_the_recommended_spacing_are_close_enough(tmp_path, step, top):
    table, _ = of_pass(tmp_path, step, top)
    assert not table.is_exact
    assert f"a row every {step:g} s is too coarse" in table.summary
    closer = float(re.search(r"a row every (\S+) s keeps it below", table.summary).group(1))
    finer, since = of_pass(tmp_path, closer, top)
    assert true_error(finer, since, top) < MOST_ERROR


def test_closer_rows_are_not_recommended_if_the_angles_scatter(tmp_path):
    table, _ = of_pass(tmp_path, 2.0, 60.0, digits=0)
    assert "the angles scatter" in table.summary
    assert not table.is_exact


def test_a_table_of_few_rows_does_not_show_its_error(tmp_path):
    table, _ = of_pass(tmp_path, 120.0, 3.0)
    assert not table.is_exact
    assert "give each pass at least 5 rows" in table.summary


def test_the_line_about_a_table_is_printed_once_when_it_is_read(tmp_path):
    """A warning goes to standard error; no daemon is needed for either."""
    nowhere = ("--socket", tmp_path / "none.sock")
    of_pass(tmp_path, 10.0, 85.0)
    done = inside("serve", "rotctld", "--ephemeris", tmp_path / "pass.csv", *nowhere)
    assert done.stdout.count("the target is known to") == 1
    assert "pass.csv" not in done.stderr
    of_pass(tmp_path, 60.0, 85.0)
    done = inside("serve", "rotctld", "--ephemeris", tmp_path / "pass.csv", *nowhere)
    assert done.stdout == ""
    assert done.stderr.count("a row every 60 s is too coarse") == 1


@pytest.mark.parametrize("digits", [0, 1, 3])
@pytest.mark.parametrize("height", [180.0, 500.0, 1500.0])
def test_no_row_of_a_true_pass_counts_as_wrong(tmp_path, digits, height):
    """In any spacing and at any phase, with angles that are rounded to whole degrees too."""
    for step in (1.0, 5.0, 10.0, 30.0, 60.0, 120.0):
        for top in (5.0, 45.0, 89.9):
            for phase in (0.0, 0.4, 0.7):
                if 2.0 * half_pass(top, height) > 4.0 * step:
                    table, since = of_pass(
                        tmp_path, step, top, phase=phase, height=height, digits=digits
                    )
                    assert np.isfinite(table.target.at(NOW + since)).all()


@pytest.mark.parametrize("column", [0, 1])
def test_a_row_whose_decimal_point_is_lost_is_named(tmp_path, column):
    """Each row of a pass in turn, if its direction is then far from its own."""
    half = half_pass(60.0)
    since = np.arange(-half, half, 10.0)
    right = angles(orbit(since, 60.0))
    named = 0
    for row in range(len(since)):
        wrong = [values.copy() for values in right]
        wrong[column][row] /= 10.0
        off = math.degrees(math.dist(vectors(*wrong)[row], vectors(*right)[row]))
        if off < 12.0:
            continue
        with pytest.raises(OrientdError) as caught:
            from_table(written(tmp_path, since, *wrong))
        said = str(caught.value)
        assert said.startswith(f"{tmp_path}/pass.csv, line {row + 2}: azimuth ")
        assert f"elevation {wrong[1][row]:.4g}"[:14] in said
        assert "degrees off the path of the rows around it, expected about azimuth" in said
        assert said.endswith("check the decimal points of this row")
        named += 1
    assert named > 20


HEAD = "time,azimuth,elevation\n"
AT = "1800000000"
AFTER = f"{HEAD}{AT},10,20\n1800000001,11,21\n"

# The file, and the line that refuses it.
WRONG = {
    "a decimal point lost in the azimuth": (
        f"{HEAD}{AT},24435,20\n",
        "line 2, azimuth: expected -720 to 720 degrees, got 24435; check the decimal point",
    ),
    "a decimal point lost in the elevation": (
        f"{AFTER}1800000002,12,-2443.5\n",
        "line 4, elevation: expected -90 to 180 degrees, got -2443.5; check the decimal point",
    ),
    "an angle that is no number": (
        f"{AFTER}1800000002,12,low\n",
        "line 4, elevation: expected -90 to 180 degrees, got 'low'; write the number alone",
    ),
    "an empty cell": (
        f"{AFTER}1800000002,,22\n",
        "line 4, azimuth: expected -720 to 720 degrees, got ''; fill it in, or leave out the row",
    ),
    "no finite number": (
        f"{HEAD}{AT},nan,20\n",
        "line 2, azimuth: expected -720 to 720 degrees, got nan",
    ),
    "times in milliseconds": (
        f"{HEAD}{AT}000,10,20\n",
        "line 2, time: expected Unix time in s, of the years 2000 to 2100, got 1800000000000; "
        "convert it from ms to s",
    ),
    "times since the start of the pass": (
        f"{HEAD}0,10,20\n1,11,21\n2,12,22\n",
        "line 2, time: expected Unix time in s, of the years 2000 to 2100, got 0; "
        "check its unit and its digits",
    ),
    "a date of another form": (
        f"{HEAD}01.05.2026 12:00,10,20\n",
        "line 2, time: expected Unix time in s, or ISO 8601 as in 2026-05-01T12:00:00Z, "
        "got '01.05.2026 12:00'; write it so",
    ),
    "rows out of order": (
        f"{AFTER}\n1800000000.5,12,22\n",
        "line 5, time: expected a time after 2027-01-15T08:00:01 of line 3, "
        "got 2027-01-15T08:00:00.5; sort the rows by time",
    ),
    "decimal commas": (
        f"{HEAD}{AT},10,5,20,5\n",
        "line 2: expected 3 cells, got 5; write numbers with a decimal point",
    ),
    "semicolons": (
        f"time;azimuth;elevation\n{AT};10;20\n",
        "line 1: expected the columns time, azimuth, elevation, got 'time;azimuth;elevation' with "
        "no time; name the columns in the first line, with commas between",
    ),
    "no names of columns": (
        f"{AT},10,20\n1800000001,11,21\n",
        "line 1: expected the columns time, azimuth, elevation, got '1800000000,10,20' with no "
        "time; name the columns in the first line, with commas between",
    ),
    "two rows": (AFTER, "expected at least 3 rows, got 2; add rows"),
    "a column twice": (
        f"time,azimuth,azimuth,elevation\n{AT},1,10,20\n",
        "line 1: two columns are called 'azimuth'; rename one",
    ),
    "a quote that is left open": (
        f'{HEAD}{AT},10,20\n1800000001,"11,21\n1800000002,12,22\n',
        "line 3: a quote that is not closed in its line; remove it",
    ),
    "a quote that a later line closes": (
        f'{HEAD}{AT},10,20\n1800000001,"11,21\n1800000002,12,22"\n',
        "line 3: a quote that is not closed in its line; remove it",
    ),
    "a number with an underscore": (
        f"{HEAD}{AT},1_0,20\n",
        "line 2, azimuth: expected -720 to 720 degrees, got '1_0'; write the number alone",
    ),
    "the sign of degrees": (
        f"{HEAD}{AT},10°,20\n",
        "line 2, azimuth: expected -720 to 720 degrees, got '10°'; write the number alone",
    ),
    "a hexadecimal number": (
        f"{HEAD}{AT},0x10,20\n",
        "line 2, azimuth: expected -720 to 720 degrees, got '0x10'; write the number alone",
    ),
    "a cell less": (
        f"{HEAD}{AT},10\n",
        "line 2, elevation: expected -90 to 180 degrees, got ''; fill it in, or leave out the row",
    ),
    "a time twice": (
        f"{AFTER}1800000001,12,22\n",
        "line 4, time: expected a time after 2027-01-15T08:00:01 of line 3, "
        "got 2027-01-15T08:00:01; sort the rows by time",
    ),
    "a month that is none": (
        f"{HEAD}2026-13-01T00:00:00Z,10,20\n",
        "line 2, time: expected Unix time in s, or ISO 8601 as in 2026-05-01T12:00:00Z, "
        "got '2026-13-01T00:00:00Z'; write it so",
    ),
    "a time that is no number": (
        f"{HEAD}nan,10,20\n",
        "line 2, time: expected Unix time in s, of the years 2000 to 2100, got nan; "
        "check its unit and its digits",
    ),
    "an empty file": (
        "",
        "line 1: expected the columns time, azimuth, elevation, got '' with no time; "
        "name the columns in the first line, with commas between",
    ),
}


@pytest.mark.parametrize(
    ("text", "line"), WRONG.values(), ids=[name.replace(" ", "_") for name in WRONG]
)
def test_a_wrong_table_is_refused_with_its_line_and_column(tmp_path, text, line):
    table = tmp_path / "pass.csv"
    table.write_text(text)
    done = inside("serve", "rotctld", "--ephemeris", table, "--socket", tmp_path / "none.sock")
    joint = ", " if line.startswith("line") else ": "
    assert done.stderr.startswith(f"orientd: {table}{joint}{line}")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    table = tmp_path / "pass.csv"
    table.write_bytes(b"PK\x03\x04\xff\xfe")
    with pytest.raises(OrientdError, match=r"pass\.csv: not a text file"):
        from_table(table)
