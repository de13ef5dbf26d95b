"""The commands about recordings, without a daemon."""

import json
import os
import signal
import sys

import numpy as np
import pytest
from command_line import assert_refused, inside
from hand_held import recorded as hand_held
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd.cli.commands.record import ending
from orientd.recorder.session import LiveRecording
from orientd.recorder.writer import RecordingWriter


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "a.mcap"
    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration("{}", {})
        writer.add_cycles("arm", moving(1500))
    return path


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "hand.csv"
    rows = [",".join(map(str, (t, *q))) for t, q in zip(*hand_held(0, seconds=30.0), strict=True)]
    path.write_text("\n".join(["time_s,qw,qx,qy,qz", *rows]))
    return path


def test_parquet_holds_the_same_table(recording, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for name in ("a.npz", "a.parquet"):
        assert inside("export", recording, "-o", tmp_path / name).returncode == 0
    table = parquet.read_table(tmp_path / "a.parquet")
    with np.load(tmp_path / "a.npz") as opened:
        assert table.column_names == list(opened)
        for name in opened:
            np.testing.assert_array_equal(table[name].to_numpy(), opened[name])


def test_parquet_without_pyarrow_is_refused_in_one_line(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = inside("export", recording, "-o", tmp_path / "a.parquet")
    assert_refused(done, "pip install 'orientd-motion[parquet]'")


def test_an_ending_that_is_not_known_is_a_mistake_of_usage(recording, tmp_path):
    assert inside("export", recording, "-o", tmp_path / "a.xlsx").returncode == 2


def test_replay_says_what_it_made_of_the_samples_and_certifies(table, tmp_path):
    out = tmp_path / "a.json"
    done = inside("replay", table, "--dry-run", "-o", out, "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["fit"]["noise_deg"] == pytest.approx(0.5, rel=0.25)
    assert 10 * told["fit"]["knots"] <= told["fit"]["samples"]
    assert told["fit"]["error_deg"] <= 1.0
    peak = told["plan"]["certificate"]["peak_velocity"]
    assert 0.0 < peak["value"] <= peak["limit"]
    again = inside("plan", out, "--json")
    assert again.returncode == 0, again.stderr
    planned = json.loads(again.stdout)["plan"]
    assert planned["duration"] == pytest.approx(told["plan"]["duration"], abs=0.01)


def test_replay_as_quickly_as_the_limits_permit(table):
    quick = inside("replay", table, "--dry-run", "--pace", "minimum", "--json")
    assert json.loads(quick.stdout)["slower"] < 1.0


def test_ctrl_c_ends_a_recording_while_the_interrupted_code_holds_its_lock(tmp_path):
    session = LiveRecording(tmp_path / "a.mcap")
    with ending(session, None):
        with session.ending._cond:  # as the main thread does within each wait
            os.kill(os.getpid(), signal.SIGINT)
        assert session.ending.wait(10.0)
