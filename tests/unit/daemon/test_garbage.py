"""What was loaded is looked at once, and never again."""

import os.path
import subprocess
import sys

import pytest
from orientd.planner.fast import KERNELS

from orientd.curves.fast import KERNEL, Background, Status
from orientd.daemon import garbage


@pytest.fixture
def spared(monkeypatch):
    """Return how often something was spared: an entry each."""
    found = []
    monkeypatch.setattr(garbage, "spare", lambda: found.append(True))
    return found


def test_what_there_is_is_left_out_of_collections():
    code = (
        "import gc, orientd.config\n"
        "from orientd.daemon.garbage import spare\n"
        "before = len(gc.get_objects()); spare()\n"
        "print(before, gc.get_freeze_count(), len(gc.get_objects()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    before, frozen, left = map(int, done.stdout.split())
    assert frozen > 0.9 * before
    assert left < 0.1 * before


def test_what_loads_late_is_spared_once_all_of_it_is_there(spared, monkeypatch):
    sparing = garbage.LateSparing()
    for curves, planner in (
        (Status.NOT_STARTED, Status.NOT_STARTED),
        (Status.LOADING, Status.NOT_STARTED),
        (Status.READY, Status.LOADING),
    ):
        monkeypatch.setattr(KERNEL, "status", curves)
        monkeypatch.setattr(KERNELS, "status", planner)
        sparing.look()
        assert not spared
    monkeypatch.setattr(KERNELS, "status", Status.READY)
    sparing.look()
    sparing.look()
    assert len(spared) == 1


@pytest.mark.parametrize("status", [Status.MISSING, Status.FAILED])
def test_kernels_that_will_never_be_there_are_not_waited_for(spared, monkeypatch, status):
    monkeypatch.setattr(KERNEL, "status", status)
    garbage.LateSparing().look()
    assert len(spared) == 1


def test_what_each_kernel_leaves_is_spared_before_the_next_is_compiled(spared, monkeypatch):
    loaded = Background({"join": "os.path:join", "split": "os.path:split"})
    monkeypatch.setattr("orientd.planner.fast.KERNELS", loaded)
    monkeypatch.setattr(KERNEL, "after_each", None)
    garbage.LateSparing().expect()
    assert loaded.wait_ready(60)
    assert loaded.split is os.path.split
    assert len(spared) == 2


def test_nothing_more_is_spared_one_by_one_once_all_of_it_is_there(spared, monkeypatch):
    monkeypatch.setattr(KERNEL, "after_each", None)
    monkeypatch.setattr(KERNELS, "status", Status.READY)
    sparing = garbage.LateSparing()
    sparing.look()
    sparing.expect()
    assert KERNEL.after_each is None
