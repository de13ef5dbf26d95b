"""How commands speak."""

import json
import math
import signal
from dataclasses import dataclass
from enum import Enum, IntEnum
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, inside

from orientd.cli.commands import daemon_commands
from orientd.cli.output import Output, plain, table
from orientd.errors import LimitError, LimitKind, OrientdError, RequestError
from orientd.stream.records import ServoState


class Colour(Enum):
    DARK_RED = 1


@dataclass
class Inner:
    q: tuple
    position: tuple


def test_everything_becomes_what_json_holds():
    content = {
        "dataclass": Inner((1.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
        "enum": Colour.DARK_RED,
        "number": ServoState.HOLDING,
        "array": np.arange(3.0),
        "scalar": np.float64(2.5),
        "path": Path("/x"),
        "endless": math.inf,
        "unknown": math.nan,
        5: None,
        "flag": True,
    }
    assert plain(content) == {
        "dataclass": {
            "q": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
            "position": [1.0, 2.0, 3.0],
        },
        "enum": "dark_red",
        "number": "holding",
        "array": [0.0, 1.0, 2.0],
        "scalar": 2.5,
        "path": "/x",
        "endless": None,
        "unknown": None,
        "5": None,
        "flag": True,
    }
    json.dumps(plain(content), allow_nan=False)


def test_numbers_that_have_names_are_told_by_name():
    class Count(IntEnum):
        ONE = 1

    assert plain(Count.ONE) == "one"


def test_a_table_is_never_cut_off():
    rows = [["a" * 300, "b"], ["c", "d" * 300]]
    header, *lines = table(["one", "two"], rows)
    assert header.split() == ["one", "two"]
    assert [line.split() for line in lines] == rows


@pytest.fixture
def run(monkeypatch):
    """Run a command in which an error is raised."""

    def run(error, *arguments):
        def methods(out: Output) -> None:
            raise error

        monkeypatch.setattr(daemon_commands, "methods", methods)
        return inside("methods", *arguments)

    return run


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OrientdError("it is\nso"), "orientd: it is so\n"),
        (RequestError("keyframes[1]", "missing"), "orientd: keyframes[1]: missing\n"),
        (FileNotFoundError(2, "No such file", "x\ny"), "orientd: x y: No such file\n"),
        (MemoryError(), "orientd: there is not enough memory for this\n"),
    ],
)
def test_what_goes_wrong_is_one_line_and_status_1(run, error, line):
    result = run(error)
    assert (result.returncode, result.stdout, result.stderr) == (1, "", line)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_is_one_line_and_the_status_that_shells_expect(run, number, status):
    result = run(KeyboardInterrupt(number))
    assert (result.returncode, result.stderr) == (status, "orientd: interrupted\n")


def test_what_goes_wrong_is_one_object_for_programs(run):
    error = LimitError("angular velocity", 3.0, 2.5, 0.5, "rad/s", kind=LimitKind.VELOCITY)
    result = run(error, "--json")
    assert (result.returncode, result.stdout) == (1, "")
    assert json.loads(result.stderr) == {
        "error": {
            "kind": "LimitError",
            "message": str(error),
            "quantity": "angular velocity",
            "value": 3.0,
            "limit": 2.5,
            "time": 0.5,
            "unit": "rad/s",
        }
    }
    field = json.loads(run(RequestError("device", "no"), "--json").stderr)["error"]["field"]
    assert field == "device"


def test_a_mistake_of_ours_is_one_line_which_says_where_it_was_made(run):
    result = run(ZeroDivisionError("by zero"))
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.startswith("orientd: a mistake of orientd's own, ZeroDivisionError at ")
    assert len(result.stderr.splitlines()) == 1


def test_a_mistake_of_ours_is_shown_whole_to_whoever_asks_for_it(run, monkeypatch):
    monkeypatch.setenv("ORIENTD_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        run(ZeroDivisionError())


def test_an_address_is_that_of_one_command_alone(monkeypatch, tmp_path):
    monkeypatch.delenv("ORIENTD_ADDRESS", raising=False)
    socket = tmp_path / "none.sock"
    assert_refused(inside("status", "--address", "localhost:1", "--socket", socket), "localhost:1")
    assert_refused(inside("status", "--socket", socket), f"no daemon answers at {socket}")


def test_a_motion_that_begins_inside_a_cone_is_printed_as_inside(tmp_path):
    path = tmp_path / "motion.yaml"
    path.write_text(
        "keyframes: [{rotation_vector: [0, 0, 0]}, {rotation_vector: [0, 0, 1.5]}]\n"
        "keep_out: [{name: lamp, half_angle_deg: 10, direction: [1, 0.1, 0]}]\n"
    )
    assert "keep-out lamp        4.29 deg inside at 0.000 s\n" in inside("plan", path).stdout
