"""A driver whose vendor's packages live in another environment, in which nothing of ours is."""

import contextlib
import importlib.util
import json
import shutil
import subprocess
import venv
from pathlib import Path

import pytest
from command_line import begin, environment, orientd
from gimbal_bench import GimbalDaemon, await_hold
from harness import until

import orientd_ur
from orientd import connect
from orientd.driver import python_command, python_version
from orientd.errors import ConfigError
from orientd.protocol import control_pb2 as pb

OURS = Path(importlib.util.find_spec("numpy").origin).parents[1]

DRIVER = """
from orientd.driver import IDENTITY, Driver, Feedback, Finding, PartHealth, Verdict


class PinnedDriver(Driver):
    name = "pinned"

    def open(self):
        import vendor

        self._newest = None

        self._vendor = vendor

    def enable(self):
        self._newest = Feedback(self.clock.now_ns(), IDENTITY)
        return self._newest

    def read(self):
        return self._newest

    def write(self, setpoint):
        self._newest = Feedback(self.clock.now_ns(), setpoint.q, joints=())

    def disable(self):
        pass

    def close(self):
        pass

    def health(self):
        return [PartHealth(f"vendor {self._vendor.VERSION}", self.clock.now_ns(), 12.0)]

    def notices(self):
        return ()

    def diagnose(self):
        import vendor

        print("a vendor's library prints")
        return [Finding("vendor", vendor.VERSION, Verdict.OK)]
"""


@pytest.fixture
def python(tmp_path):
    """The interpreter of a new environment without any package."""
    venv.create(tmp_path / "venv", with_pip=False)
    return tmp_path / "venv" / "bin" / "python"


def site(python):
    done = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True,
        text=True,
        check=True,
    )
    return Path(done.stdout.strip())


@pytest.fixture
def pinned(tmp_path):
    """An environment of ours with a driver and version 1 of what it needs."""
    folder = tmp_path / "site"
    (folder / "pinned-1.0.dist-info").mkdir(parents=True)
    (folder / "pinned_driver.py").write_text(DRIVER)
    (folder / "vendor.py").write_text('VERSION = "1 of ours"\n')
    (folder / "pinned-1.0.dist-info" / "METADATA").write_text("Name: pinned\nVersion: 1.0\n")
    (folder / "pinned-1.0.dist-info" / "entry_points.txt").write_text(
        "[orientd.drivers]\npinned = pinned_driver:PinnedDriver\n"
    )
    return environment(PYTHONPATH=str(folder), XDG_STATE_HOME=str(tmp_path / "state"))


def configure(folder, python):
    path = folder / "pinned.toml"
    path.write_text(
        f'[daemon]\nsocket = "{folder}/control.sock"\n'
        f'[devices.arm]\ndriver = "pinned"\npython = "{python}"\n'
    )
    return path


@contextlib.contextmanager
def running(config, env):
    process = begin("run", "--config", config, env=env)
    try:
        assert "ready at" in process.stdout.readline()
        yield config.parent / "control.sock"
    finally:
        process.terminate()
        process.communicate(timeout=30)


def test_each_has_its_own_version_of_a_package(tmp_path, python, pinned):
    (site(python) / "vendor.py").write_text('VERSION = "2 of theirs"\n')
    with running(configure(tmp_path, python), pinned) as socket, connect(socket) as robot:
        until(lambda: robot.state().devices["arm"].health, "health")
        device = robot.state().devices["arm"]
        assert [part.name for part in device.health] == ["vendor 2 of theirs"]
        assert Path(f"/proc/{device.servo_pid}/cmdline").read_bytes().startswith(bytes(python))
        assert (
            robot.move([{"euler": {"axes": "z", "degrees": [10]}}]).wait().outcome
            == pb.OUTCOME_DONE
        )


def test_doctor_looks_from_there(tmp_path, python, pinned):
    (site(python) / "vendor.py").write_text('VERSION = "2 of theirs"\n')
    config = configure(tmp_path, python)
    done = orientd("doctor", "--config", config, "--json", env=pinned)
    found = {one["name"]: one["found"] for one in json.loads(done.stdout)["findings"]}
    assert found["arm: vendor"] == "2 of theirs"
    assert found["arm: interpreter"].startswith(f"{python}, Python 3.")


def test_nothing_of_ours_is_to_be_had_there(tmp_path, python):
    code = "import sys; assert orientd; print(*sys.path, sep=chr(10)); import numpy"
    (site(python) / "look.py").write_text(f"import orientd.servo.process, orientd_ur\n{code}")
    done = subprocess.run(
        python_command(str(python), "look", "orientd_ur:UrDriver"),
        capture_output=True,
        text=True,
        env=environment(PYTHONPATH=str(OURS)),
        check=False,
    )
    assert "No module named 'numpy'" in done.stderr
    assert str(OURS) not in done.stdout.splitlines()
    assert str(Path(orientd_ur.__file__).parents[1]) not in done.stdout.splitlines()


def test_a_package_that_is_missing_there_is_one_line(tmp_path, python, pinned):
    config = configure(tmp_path, python)
    line = f"the driver needs the package 'vendor', which {python} does not have"
    done = orientd("doctor", "--config", config, "--json", env=pinned)
    (row,) = (one for one in json.loads(done.stdout)["findings"] if one["name"].startswith("arm"))
    assert row["found"].endswith(line)
    assert (row["name"], row["verdict"]) == ("arm: interpreter", "problem")
    process = begin("run", "--config", config, env=pinned)
    try:
        assert line in process.stdout.readline()
    finally:
        process.terminate()
        process.communicate(timeout=30)


@pytest.mark.parametrize(
    ("interpreter", "problem"),
    [
        ("/no/such/python", "cannot run /no/such/python: No such file or directory"),
        ("/bin/true", "/bin/true is not a Python interpreter"),
        ("/etc/passwd", "cannot run /etc/passwd: Permission denied"),
    ],
)
def test_an_interpreter_that_cannot_be_used_is_one_line(tmp_path, pinned, interpreter, problem):
    config = configure(tmp_path, interpreter)
    done = orientd("run", "--config", config, env=pinned)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].endswith(f"devices.arm.python: {problem}")
    done = orientd("doctor", "--config", config, "--json", env=pinned)
    rows = {one["name"]: one["found"] for one in json.loads(done.stdout)["findings"]}
    assert rows["arm: interpreter"] == problem


def test_an_interpreter_that_is_too_old_is_refused(tmp_path):
    old = tmp_path / "python"
    old.write_text("#!/bin/sh\necho Python 3 9 18\n")
    old.chmod(0o755)
    with pytest.raises(ConfigError, match=r"is Python 3\.9\.18; the servo process needs 3\.11"):
        python_version(str(old))


def test_an_interpreter_must_be_an_absolute_path(tmp_path, pinned):
    done = orientd("doctor", "--config", configure(tmp_path, "venv/bin/python"), env=pinned)
    assert "devices.arm.python: expected an absolute path of a Python interpreter" in done.stderr


def test_a_gimbal_moves_on_another_version_of_the_vendors_sdk(tmp_path, bus, python):
    packages = site(python)
    for name in ("dynamixel_sdk", "serial"):
        origin = Path(importlib.util.find_spec(name).origin)
        shutil.copytree(origin.parent, packages / name)
    loaded = tmp_path / "loaded"
    with (packages / "dynamixel_sdk" / "__init__.py").open("a") as file:
        file.write(f"\nopen({str(loaded)!r}, 'w').write(__file__)\n")
    change = ('driver = "dynamixel"', f'driver = "dynamixel"\npython = "{python}"')
    daemon = GimbalDaemon(tmp_path, bus.link, change).start()
    await_hold(daemon, "gimbal")
    assert Path(loaded.read_text()).is_relative_to(packages)
    with connect(daemon.socket) as robot:
        assert (
            robot.move([{"euler": {"axes": "z", "degrees": [10]}}]).wait().outcome
            == pb.OUTCOME_DONE
        )
    daemon.end()
    done = orientd("doctor", "--config", daemon.config, "--json")
    found = {one["name"]: one["found"] for one in json.loads(done.stdout)["findings"]}
    assert found["gimbal: interpreter"].startswith(f"{python}, Python 3.")
    assert len(found) > 10
