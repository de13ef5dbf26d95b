import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import settings

# A machine that stands still for half a second is no defect.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# The path of a socket has at most 107 bytes, and other users cannot look into a private home.
os.environ["TMPDIR"] = tempfile.tempdir = "/tmp"

# Processes of the tests start and print as for a user, whatever the environment says.
for name in ("PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE"):
    os.environ.pop(name, None)

# Programs that a shell starts in the background ignore it, and so would all that is started here.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The rigs that several test modules share.
for folder in (
    "unit/servo",
    "unit/servo/tracking",
    "unit/rotctld",
    "unit/client",
    "unit/daemon",
    "unit/curves",
    "unit/planner",
    "unit/viewer",
    "unit/recorder",
    "unit/replay",
    "unit/driver_ur",
    "unit/dynamixel_bus",
    "system",
    "world",
    "chaos",
    "emulated",
    "storm",
    "unit/driver_dynamixel",
    "drivers/ur",
    "data/standard",
    "unit/mechanism",
    "bench",
    "docs",
):
    sys.path.insert(0, str(Path(__file__).parent / folder))


WORLD = pytest.StashKey()

TERMINALS = {"bus", "gimbal"}
"""Fixtures that are devices on terminals."""

# Whatever a test starts inherits this, so that what is left of a run is known by it.
os.environ.setdefault("TEST_RUN_OF_ORIENTD", str(os.getpid()))


def left_running():
    """Return the processes that tests of this run have started, by their number.

    That of Python which watches this run's own pools ends with this run.
    """
    mark, found = f"TEST_RUN_OF_ORIENTD={os.environ['TEST_RUN_OF_ORIENTD']}".encode(), {}
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark in (path / "environ").read_bytes().split(b"\0"):
                words = (path / "cmdline").read_bytes().replace(b"\0", b" ")
                parent = int((path / "stat").read_bytes().rpartition(b")")[2].split()[1])
                if parent != os.getpid() or b" multiprocessing.resource_tracker " not in words:
                    found[int(path.name)] = words.decode(errors="replace").strip()
    found.pop(os.getpid(), None)
    return found


def pytest_addoption(parser):
    """Add the options of the world."""
    parser.addoption("--real", action="store_true", help="run the world's tests as processes")
    parser.addoption(
        "--systems",
        choices=("all", "virtual", "processes", "terminals"),
        default="all",
        help="run only the tests of this kind: in virtual time or without any, with processes, "
        "with terminals",
    )
    parser.addoption("--seed", default="1", help="seed of the world")


def is_virtual(item):
    """Return whether a test runs in virtual time."""
    if item is None or item.config.getoption("real"):
        return False
    return bool(item.get_closest_marker("world")) and not item.get_closest_marker("real")


def kind_of(item):
    """Return what a test of a whole system runs in or with."""
    if is_virtual(item):
        return "virtual"
    tests = Path(__file__).parent
    if not item.path.is_relative_to(tests):
        return "processes" if item.path.is_relative_to(tests.parent / "examples") else "virtual"
    folder = item.path.relative_to(tests).parts[:-1]
    if folder[0] in ("world", "emulated", "unit", "docs"):
        return "virtual"
    is_terminal = TERMINALS.intersection(item.fixturenames) or folder[-1] == "dynamixel"
    return "terminals" if is_terminal else "processes"


def pytest_collection_modifyitems(config, items):
    """Choose tests, and let those of a module that need real processes follow its others."""
    wanted = config.getoption("systems")
    if wanted != "all":
        chosen = [item for item in items if kind_of(item) == wanted]
        config.hook.pytest_deselected(items=[item for item in items if kind_of(item) != wanted])
        items[:] = chosen
    places = {}
    for item in items:
        places.setdefault(item.location[0], len(places))
    items.sort(key=lambda item: (places[item.location[0]], not is_virtual(item)))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Run a test of the world, with its fixtures, in virtual time."""
    if not is_virtual(item):
        return None
    if WORLD not in item.config.stash:
        from virtual_world import VirtualRunner

        item.config.stash[WORLD] = VirtualRunner(item.config.getoption("seed"))
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    # What a module's fixtures have made in virtual time is of no use in real time.
    item.config.stash[WORLD].run(item, nextitem if is_virtual(nextitem) else None)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_runtest_logreport(report):
    """Note a test that has passed, for the ledger of promises; see promises.py."""
    folder = os.environ.get("TESTS_THAT_PASSED")
    is_worker = "PYTEST_XDIST_WORKER" in os.environ
    if folder and report.when == "call" and report.passed and not is_worker:
        function = os.path.relpath(report.nodeid.partition("[")[0], "tests")
        with (Path(folder) / str(os.getpid())).open("a") as names:
            names.write(f"{function}\n")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session):
    """Fail a run that leaves processes behind, and end these."""
    if os.environ["TEST_RUN_OF_ORIENTD"] != str(os.getpid()):
        return  # one of several workers
    ends = time.monotonic() + 10.0
    while (left := left_running()) and time.monotonic() < ends:
        time.sleep(0.1)
    for pid, words in left.items():
        sys.stderr.write(f"\nstill running after the tests: process {pid}, {words}\n")
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    if left and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="module")
def open_folder():
    """A folder that every user may look into: pytest makes its own for one user alone."""
    folder = Path(tempfile.mkdtemp(prefix="orientd-"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(autouse=True)
def _no_command_outlives_its_test():
    """Ends the commands that a failed test has left running."""
    begun = getattr(sys.modules.get("command_line"), "BEGUN", [])
    before = len(begun)
    yield
    for process in begun[before:]:
        if process.poll() is None:
            process.terminate()
            try:
                process.communicate(timeout=20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
    del begun[before:]
