"""The examples run: each in a folder of its own, without what it says it does not need."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
LIBRARY = EXAMPLES / "curves_as_a_library.py"
BLOCKED = "import runpy, sys\nsys.modules.update(dict.fromkeys({names}))\nrunpy.run_path({path!r})"


def run(path, folder, *names):
    program = BLOCKED.format(names=names, path=str(path))
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True
    )


def test_curves_are_a_library_of_a_few_lines(tmp_path):
    pytest.importorskip("matplotlib")
    assert len(LIBRARY.read_text().splitlines()) <= 15
    done = run(LIBRARY, tmp_path, "grpc", "fcntl", "resource")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "turn.svg").stat().st_size > 10_000


def test_only_the_picture_needs_matplotlib(tmp_path):
    done = run(LIBRARY, tmp_path, "grpc", "matplotlib", "fcntl", "resource")
    assert done.returncode == 1
    assert "pictures need Matplotlib" in done.stderr.splitlines()[-1]
    assert (tmp_path / "turn.npz").exists()
