"""Single lines of commands that a reader must understand at once."""

import os

import pytest
from command_line import assert_refused, inside
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd import plots
from orientd.cli import texts
from orientd.cli.commands import doctor
from orientd.cli.machine import Finding, Verdict
from orientd.cli.output import Output
from orientd.protocol import control_pb2 as pb
from orientd.recorder.writer import RecordingWriter


def test_a_file_that_cannot_be_read_is_no_mistake_of_usage(tmp_path, monkeypatch):
    path = tmp_path / "s"
    path.touch()
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert_refused(inside("status", "--socket", path), f"{path} is not a socket")


@pytest.mark.parametrize(("number", "said"), [(1, "1 problem"), (2, "2 problems")])
def test_the_doctor_counts_in_english(capsys, number, said):
    doctor._report([Finding("clock", "slow", Verdict.PROBLEM)] * number, Output())
    assert capsys.readouterr().out.endswith(f"0 ok, 0 to improve, {said}\n")


def test_end_velocities_that_were_not_asked_for_are_not_told():
    statistics, plan = pb.MotionStatistics(), pb.Plan()
    certificate = plan.certificate
    for name in ("velocity", "acceleration", "jerk"):
        getattr(certificate, f"peak_{name}").limit = 1.0
    assert "end velocities" not in str(texts.statistics(statistics, plan))
    statistics.end_velocity_error = 1e-9
    lines = texts.statistics(statistics, plan)
    assert "end velocities       off by 1.0e-09 rad/s at the end" in lines


def test_only_the_end_of_a_recording_is_drawn(tmp_path, monkeypatch):
    path, drawn = tmp_path / "a.mcap", []
    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration("{}", {})
        writer.add_cycles("arm", moving(1500))
    monkeypatch.setattr(
        plots, "draw_recording", lambda _, cycles, q, **__: drawn.append((cycles, q))
    )
    for options in ((), ("--last", "1"), ("--last", "60")):
        assert inside("plot", path, "-o", tmp_path / "a.svg", *options).returncode == 0
    assert [len(cycles) for cycles, _ in drawn] == [1500, round(RATE_HZ), 1500]
    assert [len(q) for _, q in drawn] == [1500, round(RATE_HZ), 1500]


@pytest.mark.parametrize(
    ("arguments", "status", "line"),
    [
        (
            ["pause", "a\nb", "\x1b[2J"],
            2,
            r"orientd: got unexpected extra arguments (a b \x1b[2J); see `orientd pause --help`",
        ),
        (["disable", "--device", "\udcff"], 1, r"orientd: expected text in UTF-8, got '\udcff'"),
    ],
    ids=["what a terminal obeys", "not UTF-8"],
)
def test_arguments_are_quoted_on_one_harmless_line(arguments, status, line, tmp_path, monkeypatch):
    monkeypatch.setenv("ORIENTD_SOCKET", str(tmp_path / "none.sock"))
    done = inside(*arguments)
    assert (done.returncode, done.stderr) == (status, f"{line}\n")
