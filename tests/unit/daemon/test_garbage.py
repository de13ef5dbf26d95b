"""What was loaded is looked at once, and never again."""

import subprocess
import sys

import pytest

CODE = """
import gc
from orientd.daemon.garbage import LateSparing
sparing = LateSparing()
sparing.look()
before = gc.get_freeze_count()
from orientd.planner.fast import wait_ready
sparing.look()
loading = gc.get_freeze_count()
assert wait_ready(120)
sparing.look()
after = gc.get_freeze_count()
more = [[] for _ in range(1000)]
sparing.look()
print(before, loading, after, gc.get_freeze_count(), len(gc.get_objects()))
"""


def test_what_loads_late_is_spared_once_it_is_there():
    pytest.importorskip("numba")
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True, timeout=150
    )
    before, loading, after, again, left = map(int, done.stdout.split())
    assert before == loading == 0
    assert again == after > 50_000
    assert left < 0.1 * after
