"""Bad motion files and the one line with which each is refused, in every situation.

``tests/data/bad_motions.json`` has the text of each file and the line, in which ``FILE`` stands for
the path.  The reader of motion files refuses most of them, whatever else hinders the command.  The
planner refuses the others, so there a device that cannot move comes first.
"""

import json
from pathlib import Path

import pytest
from command_line import inside

import orientd

pytestmark = pytest.mark.world

BAD_MOTIONS = json.loads((Path(__file__).parents[1] / "data/bad_motions.json").read_text())
OF_FILES = {name for name, motion in BAD_MOTIONS.items() if motion["read_by"] == "file"}
LARGE = {  # Of these the data would be large.
    "large.yaml": ("# " + "x" * (9 << 20), "cannot read FILE: expected at most 8 MiB, got 9.0 MiB"),
    "open.yaml": (
        "[" * 100_000,
        "FILE: line 1: not YAML: nested too deeply",
    ),
    "deep.yaml": (
        "{a: " * 20_000 + "1" + "}" * 20_000,
        "FILE: line 1: not YAML: nested too deeply",
    ),
    "deep.json": (
        '{"a": ' + "[" * 100_000 + "]" * 100_000 + "}",
        "FILE: nested too deeply",
    ),
}


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """Return the path of every file, by name."""
    folder = tmp_path_factory.mktemp("bad")
    texts = {name: motion["text"] for name, motion in BAD_MOTIONS.items()}
    for name, text in {**texts, **{name: text for name, (text, _) in LARGE.items()}}.items():
        # Bytes that are no UTF-8 are surrogates in the data.
        (folder / name).write_text(text, encoding="utf-8", errors="surrogateescape")
    return {path.name: path for path in folder.iterdir()}


@pytest.fixture(autouse=True)
def _no_defaults(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for name in ("ORIENTD_SOCKET", "ORIENTD_CONFIG"):
        monkeypatch.delenv(name, raising=False)


def refusals(paths, names, *arguments, command="move"):
    """Return what a command says of each file in one line, without its name; it writes no more."""
    said = {}
    for name in names:
        done = inside(command, paths[name], *arguments)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1), name
        said[name] = done.stderr.rstrip("\n").replace(str(paths[name]), "FILE")
    return said


def lines(names=BAD_MOTIONS):
    return {name: f"orientd: {BAD_MOTIONS[name]['line']}" for name in names}


def test_there_are_many_bad_files():
    assert len(BAD_MOTIONS) >= 200
    assert len(OF_FILES) >= 200


def test_a_move_refuses_each_bad_file_with_its_line(daemon, paths):
    assert refusals(paths, BAD_MOTIONS, "--socket", daemon.socket) == lines()


def test_a_plan_without_a_daemon_refuses_each_bad_file_with_the_same_line(paths):
    assert refusals(paths, BAD_MOTIONS, command="plan") == lines()


def test_where_nobody_listens_the_file_is_refused_first(paths, tmp_path):
    assert refusals(paths, OF_FILES, "--socket", tmp_path / "nobody") == lines(OF_FILES)


def test_for_a_device_that_cannot_move_the_file_is_refused_first(daemon, paths):
    with orientd.connect(daemon.socket) as robot:
        robot.disable()
        try:
            assert refusals(paths, OF_FILES, "--socket", daemon.socket) == lines(OF_FILES)
        finally:
            robot.enable()


def test_the_error_in_json_has_the_field_of_the_line(daemon, paths):
    for name, motion in BAD_MOTIONS.items():
        done = inside("move", paths[name], "--socket", daemon.socket, "--json")
        error = json.loads(done.stderr)["error"]
        assert (done.returncode, done.stdout, error["kind"]) == (1, "", "RequestError"), name
        assert error["message"].replace(str(paths[name]), "FILE") == motion["line"]
        rest = motion["line"].removeprefix("FILE: ")
        assert rest.startswith(f"{error['field']}: " if error.get("field") else rest)


@pytest.mark.parametrize("name", LARGE)
def test_a_large_or_deep_file_is_refused_with_its_line(daemon, paths, name):
    expected = {name: f"orientd: {LARGE[name][1]}"}
    assert refusals(paths, [name], "--socket", daemon.socket) == expected
    assert refusals(paths, [name], command="plan") == expected
