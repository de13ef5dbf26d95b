"""Progress, shown."""

import fcntl
import os
import pty
import struct
import sys
import termios
import time

import pytest

from orientd.cli import output, progress
from orientd.protocol import control_pb2 as pb

REPORT = pb.MoveProgress(
    path_time=1.0,
    duration=4.0,
    state=pb.STATE_STREAMING,
    is_paused=False,
    speed=1.0,
    q=pb.Quaternion(w=1.0),
    omega_body=pb.Vector3(x=0.3, z=0.4),
    lateness=0.00012,
    tracking_error=0.0025,
    overruns=0,
)


def screen(written, width):
    """Return the lines that a terminal shows of what was written to it; none is empty."""
    lines, row, column = [[]], 0, 0
    for character in written:
        if character == "\r":
            column = 0
        elif character == "\n":
            lines.append([])
            row, column = row + 1, 0
        else:
            assert character.isprintable()
            if column == width:
                lines.append([])
                row, column = row + 1, 0
            lines[row][column : column + 1] = [character]
            column += 1
    return [line for line in ("".join(cells).rstrip() for cells in lines) if line]


def changed(**fields):
    """Return the report with other *fields*; those that are ``None`` are absent."""
    report = pb.MoveProgress.FromString(REPORT.SerializeToString())
    for name, value in fields.items():
        report.ClearField(name)
        if value is not None:
            setattr(report, name, value)
    return report


def test_a_line_has_orientation_rate_lateness_and_tracking_error(capsys):
    with progress.view("motion 1", output.Output()) as show:
        show(REPORT)
    assert capsys.readouterr().out == (
        "1.00 of 4.00 s  w +1.0000 x +0.0000 y +0.0000 z +0.0000  0.500 rad/s  late 0.120 ms  "
        "tracking 2.50 mrad\n"
    )


def test_plain_lines_come_now_and_then(capsys):
    with progress.view("motion 1", output.Output()) as show:
        for _ in range(100):
            show(REPORT)
    assert len(capsys.readouterr().out.splitlines()) < 5


def test_silence_says_nothing(capsys):
    with progress.view("motion 1", output.Output(as_json=True)) as show:
        show(REPORT)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("speed", "is_paused"), [(0.5, False), (0.0, True)])
def test_what_is_not_as_planned_is_said(capsys, speed, is_paused):
    with progress.view("motion 1", output.Output()) as show:
        show(changed(speed=speed, is_paused=is_paused, tracking_error=None))
    line = capsys.readouterr().out
    assert f"speed {speed:.2f}" in line
    assert ("paused" in line) == is_paused
    assert "tracking unknown" in line


def test_work_is_shown_on_a_terminal_alone_and_never_on_standard_output(capsys, monkeypatch):
    with output.working("planning"):
        pass
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with output.working("planning"):
        told = capsys.readouterr()
        assert told.out == ""
        assert screen(told.err, 80) == ["planning ..."]
    assert screen(told.err + capsys.readouterr().err, 80) == []


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_a_live_line_tells_the_times_however_narrow_the_terminal_is(capsys, monkeypatch, width):
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    monkeypatch.setenv("COLUMNS", str(width))
    with progress.view("motion 1", output.Output()) as show:
        show(changed(speed=0.5))
    (said,) = screen(capsys.readouterr().out, width)
    assert "motion 1" in said
    assert "1.00/4.00 s  speed 0.50" in said


@pytest.mark.parametrize("width", [1, 2, 5, 19])
def test_a_line_that_is_replaced_leaves_nothing_on_a_terminal_of_any_width(
    capsys, monkeypatch, width
):
    monkeypatch.setenv("COLUMNS", str(width))
    line, written = output.LiveLine(sys.stdout), ""
    for text in ("a long line of text that has no room", "short", "with\na line and\ta tab", ""):
        line.show(text)
        written += capsys.readouterr().out
        shown = text.replace("\n", " ").replace("\t", " ")[: width - 1].rstrip()
        assert screen(written, width) == ([shown] if shown else [])


def test_the_width_of_a_terminal_is_its_own_unless_the_environment_has_one(monkeypatch):
    main, side = pty.openpty()
    fcntl.ioctl(side, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 30, 0, 0))
    monkeypatch.delenv("COLUMNS", raising=False)
    with os.fdopen(side, "w") as terminal:
        line = output.LiveLine(terminal)
        line.show("x" * 100)
        assert os.read(main, 1000) == b"\r" + b"x" * 29
        monkeypatch.setenv("COLUMNS", "20")
        line.show("y" * 100)
        assert os.read(main, 1000).count(b"y") == 19
    os.close(main)


def test_a_name_is_shown_as_it_is_whatever_brackets_it_has(capsys, monkeypatch):
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "200")
    with progress.view("motion 1 'a[b] [/red]'", output.Output()) as show:
        show(REPORT)
    assert "motion 1 'a[b] [/red]'" in capsys.readouterr().out
    with output.working("planning a[b] [/red].yaml"):
        pass


def test_a_live_line_says_when_it_is_old(capsys, monkeypatch):
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    now = time.monotonic()
    with progress.view("motion 1", output.Output()) as show:
        show(REPORT)
        monkeypatch.setattr(progress.time, "monotonic", lambda: now + 5.0)
        # It says so while nothing is shown any more.
        written, end = "", time.perf_counter() + 30.0
        while "5 s old" not in written and time.perf_counter() < end:
            written += capsys.readouterr().out
    assert written.rpartition("\r")[2].startswith("5 s old  motion 1 1.00/4.00 s")
