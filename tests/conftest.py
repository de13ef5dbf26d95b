import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

# A machine that stands still for half a second is no defect.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# The path of a socket has at most 107 bytes, and other users cannot look into a private home.
os.environ["TMPDIR"] = tempfile.tempdir = "/tmp"

# What is started here starts and prints as it does for a user, whatever the surroundings say.
for name in ("PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE"):
    os.environ.pop(name, None)

# Programs that a shell starts in the background ignore it, and so would all that is started here.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The rigs that several test modules share.
for folder in (
    "unit/servo",
    "unit/servo/tracking",
    "unit/daemon",
    "unit/curves",
    "unit/planner",
    "unit/viewer",
    "unit/recorder",
    "unit/driver_ur",
    "unit/dynamixel_bus",
    "system",
    "chaos",
    "storm",
    "unit/driver_dynamixel",
    "drivers/ur",
    "data/standard",
    "unit/mechanism",
    "bench",
    "docs",
):
    sys.path.insert(0, str(Path(__file__).parent / folder))


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
