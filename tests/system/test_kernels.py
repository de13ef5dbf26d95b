"""The kernels of a source tree: never older than what they are built of, and read-only to run."""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from command_line import COMMAND, environment

from orientd import processor
from orientd.kernels.build import compiler

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of the source tree of which a kernel has been edited."""
    root = tmp_path_factory.mktemp("tree")
    for name in ("orientd", "adapters", "drivers", "sim"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    with (root / "orientd" / "kernels" / "c" / "brake.c").open("a") as source:
        source.write("/* edited */\n")
    return root


def run(tree, *command, **more):
    path = os.pathsep.join(str(tree / name) for name in (".", "adapters", "drivers", "sim"))
    return subprocess.run(
        command, cwd=tree, env=environment(PYTHONPATH=path, **more), capture_output=True, text=True
    )


@pytest.mark.parametrize("arguments", [["run"], ["demo"]], ids=lambda arguments: arguments[0])
def test_after_an_edit_a_command_says_in_a_line_what_to_run(tree, arguments, tmp_path):
    done = run(tree, *COMMAND, *map(str, arguments), XDG_RUNTIME_DIR=str(tmp_path))
    mend = f"run `python {tree / 'orientd' / 'kernels' / 'build.py'}`"
    (line,) = done.stderr.splitlines()
    assert line.startswith("orientd: ")
    assert line.endswith(f"the sources of orientd's kernels have changed: {mend}")
    assert (done.returncode, done.stdout) == (1, "")


def test_what_it_says_mends_it(tree, tmp_path):
    copy = tmp_path / "tree"
    shutil.copytree(tree, copy)
    level = processor.level()
    command = tmp_path / "cc"  # what is optimised takes ten times as long
    command.write_text(f'#!/bin/sh\nexec {shlex.join(compiler())} "$@" -O0\n')
    command.chmod(0o755)
    script = copy / "orientd" / "kernels" / "build.py"
    built = run(copy, sys.executable, script, level, CC=str(command))
    assert built.returncode == 0, built.stderr
    done = run(copy, sys.executable, "-c", "from orientd import kernels; print(kernels.LEVEL)")
    assert (done.stdout, done.stderr) == (f"{level}\n", "")


def test_a_level_that_nobody_knows_is_refused_in_a_line(tmp_path):
    done = run(ROOT, *COMMAND, "run", XDG_RUNTIME_DIR=str(tmp_path), ORIENTD_LEVEL="sse2")
    known = ", ".join(processor.builds())
    expected = f"orientd: ORIENTD_LEVEL: expected one of {known}, got 'sse2'\n"
    assert (done.returncode, done.stderr) == (1, expected)


@pytest.fixture
def read_only():
    """A folder that everybody may read and nobody but root may write to."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become somebody else")
def test_another_user_without_a_home_runs_them_where_nothing_can_be_written(read_only):
    for name in ("__init__.py", "errors.py", "one_line.py", "processor.py", "kernels/__init__.py"):
        (read_only / "orientd" / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / "orientd" / name, read_only / "orientd" / name)
    library = processor.library()
    (read_only / "orientd" / "kernels" / library.parent.name).mkdir()
    shutil.copy(library, read_only / library.relative_to(ROOT))
    code = (
        # What an interpreter is made of may lie where only root can read.
        "import os; from orientd import processor\n"
        "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "from orientd import kernels\n"
        "print(kernels.LEVEL, processor.library())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd="/",
        env={"PYTHONPATH": str(read_only)},
        capture_output=True,
        text=True,
    )
    expected = f"{processor.level()} {read_only / library.relative_to(ROOT)}\n"
    assert (done.stdout, done.stderr) == (expected, "")
