"""The UR driver on a machine without the client library ``ur-rtde``."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from orientd.clock import MonotonicClock
from orientd.errors import LinkError
from orientd_ur import UrDriver

CONFIG = Path(__file__).parents[3] / "config"

WITHOUT_LIBRARY = """
import importlib.abc, sys

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.startswith("rtde_"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
for name in [name for name in sys.modules if name.startswith("rtde_")]:
    del sys.modules[name]
from orientd.cli.main import app
app(sys.argv[1:])
"""


def orientd(*words):
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_LIBRARY, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=60.0,
    )


def test_motion_is_planned_offline():
    done = orientd("plan", CONFIG / "ur-turn.yaml", "--config", CONFIG / "ur.toml", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["plan"]["duration"] > 1.0


def test_robot_is_not_opened_and_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    driver = UrDriver({"host": "127.0.0.9"}, period_ns=2_000_000, clock=MonotonicClock())
    with pytest.raises(LinkError, match=r"needs ur-rtde: \S+python\S* -m pip install ur-rtde"):
        driver.open()
