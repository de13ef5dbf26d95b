"""Each emulator as a distribution of its own: built, installed alone, served, used from pytest."""

import os
import select
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / "sim"
ALONE = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
COMMANDS = {
    "emulated_ur": ["emulated-ur", "--host", "127.77.1.1"],
    "emulated_dynamixel": ["emulated-dynamixel", "--link", "port"],
}
READY_WITHIN_S = 60.0


@pytest.fixture(scope="module", params=sorted(COMMANDS))
def wheel(request, tmp_path_factory):
    """The name of a package, and the wheel that is built of it."""
    folder = tmp_path_factory.mktemp(request.param)
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder]
    subprocess.run(command, cwd=ROOT / request.param, check=True, capture_output=True)
    (file,) = folder.glob("*.whl")
    return request.param, file


def test_wheel_holds_one_package_and_needs_nothing(wheel):
    package, file = wheel
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        (metadata,) = (archive.read(name).decode() for name in names if name.endswith("/METADATA"))
    assert {name.split("/")[0].split("-")[0] for name in names} == {package}
    assert f"{package}/py.typed" in names
    assert "Requires-Dist" not in metadata
    assert "orientd" not in metadata


def test_installed_alone_it_serves(wheel, tmp_path):
    package, file = wheel
    home = tmp_path / "venv"
    venv.create(home, symlinks=True, with_pip=False)
    pip = [sys.executable, "-m", "pip", "--python", home / "bin" / "python", "install"]
    subprocess.run([*pip, "--no-index", "--quiet", file], check=True, capture_output=True)
    script, *words = COMMANDS[package]
    with subprocess.Popen(
        [home / "bin" / script, *words], cwd=tmp_path, env=ALONE, stdout=subprocess.PIPE
    ) as served:
        try:
            assert select.select([served.stdout], [], [], READY_WITHIN_S)[0]
            assert served.stdout.readline().startswith(b"ready")
        finally:
            served.terminate()
    assert served.returncode == 0


def test_fixtures_give_a_robot_and_two_buses(tmp_path):
    (tmp_path / "test_mine.py").write_text(
        "def test_robot(emulated_ur, emulated_ur_factory):\n"
        "    other = emulated_ur_factory('--model', 'ur10e')\n"
        "    emulated_ur.run('set_digital_out(2, True)')\n"
        "    emulated_ur.wait_until(lambda state: state['digital_outputs'] == 4)\n"
        "    assert other.state()['digital_outputs'] == 0\n"
        "    emulated_ur.ask('protective_stop')\n"
        "    assert emulated_ur.state()['safety_mode'] == 'PROTECTIVE_STOP'\n"
        "def test_bus(emulated_dynamixel, virtual_dynamixel):\n"
        "    assert open(emulated_dynamixel.port, 'rb', buffering=0).fileno()\n"
        "    assert 'position 2048, goal 0' in emulated_dynamixel.ask('state 1')\n"
        "    assert 'jam ID' in emulated_dynamixel.ask('help')\n"
        "    virtual_dynamixel.openPort()\n"
        "    ping = b'\\xff\\xff\\xfd\\x00\\x01\\x03\\x00\\x01\\x19\\x4e'\n"
        "    virtual_dynamixel.writePort(list(ping))\n"
        "    virtual_dynamixel.ser.timeout = 0.1\n"
        "    assert virtual_dynamixel.readPort(14)[:5] == b'\\xff\\xff\\xfd\\x00\\x01'\n"
    )
    plugins = ["-p", "emulated_ur.pytest_plugin", "-p", "emulated_dynamixel.pytest_plugin"]
    command = [sys.executable, "-m", "pytest", "-q", "-c", os.devnull, *plugins, "test_mine.py"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**ALONE, "PYTHONPATH": str(ROOT)},
    )
    assert "2 passed" in done.stdout, done.stdout
