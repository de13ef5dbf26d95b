"""The wheel, as a user gets it: built, installed away from the source tree, run."""

import math
import os
import shlex
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from orientd import processor
from orientd.kernels.build import compiler

ROOT = Path(__file__).parents[2]
EMULATORS = ("emulated_dynamixel", "emulated_ur")

pytestmark = pytest.mark.timeout(600)  # what is built there takes most of a busy machine's time


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The sources as they are handed on, and the wheel that is built of those."""
    folder = tmp_path_factory.mktemp("built")
    # What is tested here is what is in it: the environment's own kernels are compiled in full.
    quick = folder / "cc"
    quick.write_text(f'#!/bin/sh\nexec {shlex.join(compiler())} "$@" -O0\n')
    quick.chmod(0o755)
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "CC": str(quick)})
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    (file,) = built.glob("*.whl")
    return file


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
    packages = [path for path in sys.path if Path(path).name == "site-packages"]
    (site / "dependencies.pth").write_text("\n".join(packages))
    return home / "bin" / "orientd"


def run(script, *arguments, cwd):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        [script, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


def test_the_wheel_holds_every_package_with_its_types_and_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    packages = {top for top in tops if not top.endswith((".dist-info", ".data"))}
    assert {"orientd", "orientd_loopback"} <= packages
    assert all(package.startswith("orientd") for package in packages)
    assert {f"{package}/py.typed" for package in packages} <= set(names)
    assert {f"orientd/emulators/{name}/py.typed" for name in (*EMULATORS, "emulated_base")} <= set(
        names
    )
    assert "orientd/protocol/control.proto" in names
    assert {name.rpartition("/share/")[2] for name in names if "/share/" in name} == {
        "bash-completion/completions/orientd",
        "fish/vendor_completions.d/orientd.fish",
        "zsh/site-functions/_orientd",
    }


def test_an_emulator_runs_from_the_wheel_and_shares_no_file_with_its_own(script, wheel, tmp_path):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    assert run(script.parent / "python", "-c", "import emulated_ur", cwd=tmp_path).returncode
    with subprocess.Popen(
        [script, "sim", "ur", "--host", "127.77.2.1"], cwd=tmp_path, env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as process:  # fmt: skip
        assert process.stdout.readline().startswith("ready")
        process.terminate()
    own = tmp_path / "own"
    for name in EMULATORS:
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", own]
        subprocess.run(build, cwd=ROOT / "sim" / name, check=True, capture_output=True)
    files = {
        name
        for file in own.glob("*.whl")
        for name in zipfile.ZipFile(file).namelist()
        if ".dist-info/" not in name
    }
    assert files
    assert not files & set(zipfile.ZipFile(wheel).namelist())


def test_the_wheel_holds_the_kernels_of_every_level_and_nothing_that_they_are_built_of(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    kernels = {name for name in names if name.startswith("orientd/kernels/")}
    libraries = {f"orientd/kernels/{level}/{processor.LIBRARY}" for level in processor.builds()}
    assert kernels == libraries | {"orientd/kernels/__init__.py", "orientd/kernels/native.pyi"}


def test_everything_can_be_installed_where_ur_rtde_has_no_wheel(wheel):
    (name,) = (n for n in zipfile.ZipFile(wheel).namelist() if n.endswith("/METADATA"))
    metadata = zipfile.ZipFile(wheel).read(name).decode()
    required = [
        Requirement(line.removeprefix("Requires-Dist: "))
        for line in metadata.splitlines()
        if line.startswith("Requires-Dist: ")
    ]

    def brought(extra, version, machine):
        where = {"extra": extra, "python_version": version, "platform_machine": machine}
        return {one.name for one in required if not one.marker or one.marker.evaluate(where)}

    assert "ur-rtde" in brought("all", "3.12", "x86_64")
    for version, machine in [("3.13", "x86_64"), ("3.12", "aarch64")]:
        assert "ur-rtde" not in brought("all", version, machine)
        assert "ur-rtde" in brought("ur", version, machine)
        assert brought("all", version, machine) >= brought("dynamixel", version, machine)


def test_one_wheel_is_for_every_python_from_311_on(wheel):
    platform = sysconfig.get_platform().replace("-", "_")
    assert wheel.name.endswith(f"-cp311-abi3-{platform}.whl")


def test_the_sources_that_are_handed_on_hold_those_of_the_kernels_and_no_library(built):
    (file,) = built.glob("*.tar.gz")
    with tarfile.open(file) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    sources = {f"orientd/kernels/c/{source.name}" for source in processor.SOURCES.glob("*.[ch]")}
    assert sources | {"orientd/kernels/build.py"} <= names
    assert not [name for name in names if name.endswith(".so")]


def test_a_curve_is_sampled_from_the_wheel(script, tmp_path):
    code = (
        "from orientd import kernels\n"
        "from orientd.curves import METHODS\n"
        "curve = METHODS['c2_cumulative'](keys=[[1, 0, 0, 0], [0, 1, 0, 0]], times=[0.0, 1.0])\n"
        "q, _, _ = curve.evaluate([0.0, 1.0])\n"
        "print(kernels.LEVEL, abs(q).round(9).tolist())"
    )
    answer = run(script.parent / "python", "-c", code, cwd=tmp_path)
    assert answer.stdout == (
        f"{processor.level()} [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]\n"
    ), answer.stderr


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


def test_a_recording_of_another_program_is_replayed_and_drawn_from_the_wheel(script, tmp_path):
    halves = [0.3 * math.sin(k / 60) for k in range(300)]
    rows = [f"{k / 100},{math.cos(a)},0,0,{math.sin(a)}" for k, a in enumerate(halves)]
    (tmp_path / "a.csv").write_text("\n".join(["time_s,qw,qx,qy,qz", *rows]))
    for words in (("replay", "a.csv", "--dry-run"), ("plot", "a.csv", "-o", "a.svg")):
        answer = run(script, *words, cwd=tmp_path)
        assert answer.returncode == 0, answer.stderr
    assert (tmp_path / "a.svg").exists()


def test_the_script_is_that_of_the_wheel_and_not_of_the_source_tree(script, tmp_path):
    python = script.parent / "python"
    code = "import orientd, orientd_loopback; print(orientd.__file__, orientd_loopback.__file__)"
    answer = run(python, "-c", code, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert str(ROOT) + "/orientd" not in answer.stdout
    assert str(script.parents[1]) in answer.stdout


def adapters():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    return sorted(settings["project"]["entry-points"]["orientd.commands"])


@pytest.mark.parametrize("name", adapters())
def test_a_command_of_an_adapter_runs_from_the_wheel(script, tmp_path, name):
    answer = run(script, *name.split("."), "--help", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.startswith(f"Usage: orientd {name.replace('.', ' ')} ")


@pytest.mark.parametrize(
    "code",
    [
        "from orientd_bluesky import RotationAxis; print(RotationAxis.__name__)",
        "from orientd_diffusion_policy import RTDEInterpolationController as C; print(C.__name__)",
        "from orientd_rotctld import satellite_pass as p; p([0, 1, 2], [0, 9, 9], [0, 0, 9])",
    ],
)
def test_an_adapter_for_python_is_called_from_the_wheel(script, tmp_path, code):
    answer = run(script.parent / "python", "-c", code, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr


def test_a_batch_is_planned_from_the_wheel(script, tmp_path):
    (tmp_path / "all.jsonl").write_text('{"keyframes": [{"turns": [0, 0, 1]}]}\n' * 2)
    answer = run(script, "batch", "all.jsonl", "-o", "plans", cwd=tmp_path)
    assert (answer.returncode, (tmp_path / "plans" / "plans.parquet").exists()) == (0, True)
