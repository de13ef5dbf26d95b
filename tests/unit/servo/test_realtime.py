"""Scheduling of the servo process; in a process of its own, which keeps what it has got."""

import subprocess
import sys

import pytest

PROGRAM = """
import os, threading
from orientd.servo.realtime import set_scheduling
ready, ending = threading.Event(), threading.Event()
def receive():
    ready.set()
    ending.wait()
threading.Thread(target=receive).start()
ready.wait()
print(set_scheduling({priority}))
print(*{{(os.sched_getscheduler(int(t)), os.sched_getparam(int(t)).sched_priority)
        for t in os.listdir("/proc/self/task")}})
ending.set()
"""


@pytest.mark.parametrize("priority", [0, 3])
def test_threads_that_a_driver_has_started_already_come_as_early_as_the_cycle(priority):
    program = PROGRAM.format(priority=priority)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    got, of_threads = done.stdout.splitlines()
    expected = (1, priority) if got.startswith("SCHED_FIFO") else (0, 0)
    assert of_threads == str(expected)
