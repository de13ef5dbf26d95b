"""A command whose standard streams are closed, as of a job that was started without any."""

import subprocess
import sys

import pytest


def begin(*arguments, closed):
    """Begin `orientd` with standard streams *closed*, in the words of a shell."""
    return subprocess.Popen(
        ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-m", "orientd", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_command_needs_no_standard_streams(closed):
    with begin("methods", closed=closed) as process:
        _, errors = process.communicate(timeout=60.0)
    assert (process.returncode, errors) == (0, b"")


def test_a_daemon_needs_no_standard_error(tmp_path):
    arguments = "run", "--socket", tmp_path / "s", "--until-end-of-input"
    with begin(*arguments, closed="2>&-") as process:
        assert process.stdout.readline().startswith(b"ready at ")
        process.communicate(timeout=60.0)
    assert process.returncode == 0
