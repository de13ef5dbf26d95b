"""orientd without SciPy, and without the features that only Linux has."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

WITHOUT_SCIPY = """
import sys
sys.modules["scipy"] = None
"""

WITHOUT_LINUX = """
import os, signal, socket, sys

for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules[name] = None
for module, names in {
    os: ("O_CLOEXEC", "O_NOCTTY", "O_NONBLOCK", "fork", "geteuid", "getuid", "memfd_create"),
    signal: ("SIGCONT", "SIGHUP", "SIGKILL", "SIGSTOP", "SIGTTOU", "SIGURG", "pthread_kill"),
    socket: ("AF_UNIX", "SOCK_CLOEXEC", "SOCK_NONBLOCK", "SOCK_SEQPACKET"),
}.items():
    for name in names:
        delattr(module, name)
"""

COMMAND = """
from orientd.cli.start import main

main()
"""

PLAN = """
import orientd
from orientd.curves import METHODS
from orientd.curves.fitting import fit_orientations
from orientd.errors import OrientdError

keys = [[1, 0, 0, 0], [0.8, 0.6, 0, 0], [0.8, 0, 0.6, 0], [0.6, 0, 0, 0.8]]
for name in ("nielson_shieh", "spherical_quadratic", "minimum_effort", "c2_cumulative"):
    curve = METHODS[name](keys=keys, times=[0.0, 1.0, 2.0, 3.5])
    q = curve.evaluate([0.5, 3.0])[0]
keys = [orientd.Quaternion(w=1, x=0, y=0, z=0), orientd.Quaternion(w=0.8, x=0, y=0, z=0.6)]
assert orientd.plan(keys).certificate
times = [0.1 * step for step in range(40)]
fit_orientations(times, curve.evaluate([0.08 * step for step in range(40)])[0])
try:
    curve(0.5)
except OrientdError as error:
    print(error)
"""


def run(program, *arguments):
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60.0)


def printed(program, *arguments):
    done = run(program, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_curves_plans_and_fits_need_no_scipy_and_a_rotation_says_what_to_install():
    assert "pip install 'orientd-motion[scipy]'" in printed(WITHOUT_SCIPY + PLAN)


def test_curves_and_plans_need_nothing_of_linux():
    assert "SciPy" not in printed(WITHOUT_LINUX + PLAN)
    assert "end velocities" in printed(WITHOUT_LINUX + COMMAND, "plan", "config/ur-turn.yaml")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["run"], "the daemon and its servo need Linux"),
        (["status"], "this system has no Unix sockets: give the daemon's address (--address)"),
        (["status", "--address", "192.0.2.1:1"], "192.0.2.1:1 needs a certificate"),
    ],
)
def test_a_command_that_needs_linux_says_so_in_one_line(arguments, problem):
    done = run(WITHOUT_LINUX + COMMAND, *arguments)
    assert done.returncode == 1
    assert problem in done.stderr
    assert done.stderr.count("\n") == 1
