"""Commands and readers of packages that the core does not know, found by their entry points."""

import os
import re
import subprocess
import sys

import pytest
from harness import install

GREET = """
import click

@click.command()
def greet():
    \"\"\"Greet.\"\"\"
    click.echo("hello")

number = 3
"""
ENTRIES = """[orientd.commands]
greet = foreign:greet
serve.greet = foreign:greet
number = foreign:number
broken = foreign.missing:command
status = foreign:greet
"""


@pytest.fixture
def orientd(tmp_path):
    """The command line beside a package with commands."""
    install(tmp_path, "foreign", ENTRIES, GREET)

    def run(*words, python=("-m", "orientd")):
        return subprocess.run(
            [sys.executable, *python, *words],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_a_package_adds_a_command_and_one_to_a_group(orientd):
    assert orientd("greet").stdout == "hello\n"
    assert orientd("serve", "greet").stdout == "hello\n"
    assert re.search(r"^  greet +Greet\.$", orientd("--help").stdout, re.MULTILINE)
    assert re.search(r"^  greet +Greet\.$", orientd("serve", "--help").stdout, re.MULTILINE)


def test_a_package_takes_no_command_of_the_core(orientd):
    assert "hello" not in orientd("status").stdout


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("number", "orientd: foreign:number is no command: expected a click.Command, got 3\n"),
        (
            "broken",
            "orientd: cannot load foreign.missing:command, the command broken: No module named "
            "'foreign.missing'; 'foreign' is not a package\n",
        ),
    ],
)
def test_a_package_that_has_no_command_is_one_line(orientd, name, line):
    result = orientd(name)
    assert (result.returncode, result.stderr) == (1, line)


@pytest.mark.parametrize("words", [["--version"], ["stop", "--help"], ["status", "--help"]])
def test_commands_of_the_core_look_for_no_package(orientd, words):
    code = """
import sys
from orientd.cli.main import app
app(sys.argv[1:], standalone_mode=False)
print([name for name in sys.modules if name == "importlib.metadata"])
"""
    assert orientd(*words, python=("-c", code)).stdout.endswith("[]\n")


@pytest.mark.parametrize(
    ("asked", "now"),
    [
        ("from orientd import satellite_pass", "orientd_rotctld.satellite_pass"),
        ("import orientd; orientd.satellite_pass", "orientd_rotctld.satellite_pass"),
        ("from orientd import connect_fleet", "orientd_fleet.client.connect_fleet"),
        ("from orientd.fleet import move_together", "orientd_fleet.together (move_together"),
        ("from orientd.adapters import RotationAxis", "orientd_bluesky"),
        (
            "from orientd.recorder import read_orientations",
            "orientd_replay.orientations.read_orientations",
        ),
        (
            "import orientd.recorder as r; r.read_orientations",
            "orientd_replay.orientations.read_orientations",
        ),
        ("from orientd.recorder import Orientations", "orientd_replay.orientations.Orientations"),
        ("from orientd.compat import RTDEInterpolationController", "orientd_diffusion_policy"),
    ],
)
def test_a_name_that_has_moved_says_where_it_is(orientd, asked, now):
    assert now in orientd(python=("-c", asked)).stderr.splitlines()[-1]


PLOT = """
import sys
from importlib import metadata
found = metadata.entry_points
def entry_points(group):
    return [ENTRIES] if group == "orientd.recordings" else found(group=group)
metadata.entry_points = entry_points
from orientd.cli.start import main
main()
"""


@pytest.mark.parametrize(
    ("entries", "line"),
    [
        (
            "",
            "no installed package reads recordings of other programs: pip install "
            "--force-reinstall 'orientd-motion[record]'",
        ),
        (
            "metadata.EntryPoint('a', 'nowhere:read', group)",
            "cannot load nowhere:read, which reads recordings of other programs: No module named "
            "'nowhere'",
        ),
    ],
)
def test_a_foreign_recording_without_a_reader_is_one_line(orientd, tmp_path, entries, line):
    table, picture = tmp_path / "a.csv", tmp_path / "a.svg"
    table.write_text("time_s,qw,qx,qy,qz\n0,1,0,0,0\n1,0,1,0,0\n")
    words = ["plot", str(table), "-o", str(picture)]
    code = PLOT.replace("ENTRIES", entries)
    result = orientd(*words, python=("-c", code))
    assert (result.returncode, result.stderr) == (1, f"orientd: {line}\n")
    assert orientd(*words).returncode == 0
    assert picture.exists()


def test_help_names_the_commands_of_packages_and_loads_nothing_that_calculates():
    code = (
        "import sys; from orientd.cli.main import app\n"
        "try: app(['--help'])\n"
        "except SystemExit: print(sorted({'numpy', 'grpc'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert {"batch", "fleet", "replay", "serve"} <= {
        word for line in done.stdout.splitlines() for word in line.split()[:1]
    }
