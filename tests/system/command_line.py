"""The command line in processes of its own."""

from __future__ import annotations

import os
import subprocess
import sys

from click.testing import CliRunner

from orientd.cli.main import app

COMMAND = (sys.executable, "-m", "orientd")


def environment(**more):
    """Return the environment without what would lead a command elsewhere."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("ORIENTD_")}
    return {**kept, **more}


def orientd(*arguments, cwd="/", env=None, timeout=60.0):
    """Run a command to its end."""
    return subprocess.run(
        [*COMMAND, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        cwd=cwd,
        env=env or environment(),
        check=False,
    )


def inside(*arguments):
    """Run a command in this process, which is ten times as quick."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return subprocess.CompletedProcess(
        arguments, result.exit_code, stdout=result.stdout, stderr=result.stderr
    )


BEGUN = []
"""Processes that were started and may run still."""


def begin(*arguments, env=None, **more):
    """Start a command and return its process; it ends with the test that started it."""
    process = subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd="/",
        env=env or environment(),
        **more,
    )
    BEGUN.append(process)
    return process


def assert_refused(done, *parts, status=1):
    """Check that a command said what is wrong in one line on standard error, and nothing else."""
    assert done.returncode == status, done
    assert "Traceback" not in done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("orientd: ")
    for part in parts:
        assert part in line
