"""The wheel, as a user gets it: built, installed away from the source tree, run."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def script(wheel, tmp_path_factory):
    """The console script of an environment that has the wheel and not the source tree."""
    home = tmp_path_factory.mktemp("home")
    venv.create(home, symlinks=True, with_pip=False)
    site = next((home / "lib").glob("python*")) / "site-packages"
    command = [sys.executable, "-m", "pip", "--python", home / "bin" / "python", "install"]
    command += ["--no-deps", "--no-index", "--quiet", "--disable-pip-version-check", wheel]
    subprocess.run(command, check=True, capture_output=True)
    # What it depends on is taken from here; an editable install is not: its path file is not read.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return home / "bin" / "orientd"


def run(script, *arguments, cwd):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        [script, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


def test_the_wheel_holds_every_package_with_its_types_and_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    packages = {top for top in tops if not top.endswith(".dist-info")}
    assert {"orientd", "orientd_loopback", "orientd_sim"} <= packages
    assert all(package.startswith("orientd") for package in packages)
    assert {f"{package}/py.typed" for package in packages} <= set(names)
    assert "orientd/rpc/control.proto" in names
    assert "orientd/bench/loop.c" in names


def test_the_console_script_runs_from_the_wheel(script, tmp_path):
    answer = run(script, "--version", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    motion = tmp_path / "turn.yaml"
    motion.write_text(
        "keyframes:\n"
        "  - {time: 0.0, quaternion: {w: 1, x: 0, y: 0, z: 0}}\n"
        "  - {time: 1.0, rotation_vector: [0, 0, 0.5]}\n"
    )
    answer = run(script, "plan", str(motion), "--json", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    answer = run(script, "methods", "--json", cwd=tmp_path)
    assert "c2_cumulative" in answer.stdout


def test_the_script_is_that_of_the_wheel_and_not_of_the_source_tree(script, tmp_path):
    python = script.parent / "python"
    code = "import orientd, orientd_loopback; print(orientd.__file__, orientd_loopback.__file__)"
    answer = run(python, "-c", code, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert str(ROOT) + "/orientd" not in answer.stdout
    assert str(script.parents[1]) in answer.stdout
