"""The unit that is installed is one that systemd takes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from orientd.cli.commands.service import NAME, check_runs, unit
from orientd.errors import ConfigError

ANALYZE = shutil.which("systemd-analyze")


def made(user, config="/etc/orientd/orientd.toml"):
    return unit(python=sys.executable, config=Path(config), user=user)


@pytest.mark.skipif(ANALYZE is None, reason="there is no systemd here")
@pytest.mark.parametrize("user", ["root", None], ids=["system", "user"])
@pytest.mark.parametrize("config", ["/etc/orientd.toml", '/odd path/100% "$HOME"\\x.toml'])
def test_systemd_finds_nothing_wrong(tmp_path, user, config):
    path = tmp_path / NAME
    path.write_text(made(user, config))
    manager = [] if user else ["--user"]
    done = subprocess.run(
        [ANALYZE, "verify", "--man=no", *manager, str(path)],
        capture_output=True,
        text=True,
        check=False,
        env={"XDG_RUNTIME_DIR": str(tmp_path), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)},
    )
    about_it = [line for line in done.stderr.splitlines() if NAME in line]
    assert about_it == [], done.stderr


@pytest.mark.parametrize("user", ["orientd", None])
def test_it_is_told_when_it_is_ready_and_asks_for_real_time_not_for_root(user):
    lines = made(user).splitlines()
    assert "Type=notify" in lines
    assert "LimitMEMLOCK=infinity" in lines
    assert any(line.startswith("LimitRTPRIO=") for line in lines)
    assert any(line.startswith("WatchdogSec=") for line in lines)
    assert "NoNewPrivileges=yes" in lines
    for setting in ("MemoryMax", "TasksMax"):
        assert any(line.startswith(f"{setting}=") for line in lines)
    for setting in ("CacheDirectory", "StateDirectory", "RuntimeDirectory"):
        assert (f"{setting}=orientd" in lines) == (user is not None)
    assert ("AmbientCapabilities=" in lines) == (user is not None)
    assert not [line for line in lines if line.startswith("RestrictRealtime")]


@pytest.mark.skipif(os.getuid() != 0, reason="becomes another user, which root may")
def test_an_interpreter_or_a_file_that_the_service_cannot_use_is_refused(tmp_path):
    # Below a folder of mode 0700, as a root user's home is.
    tmp_path.chmod(0o700)
    closed = tmp_path / "python"
    closed.symlink_to(sys.executable)
    with pytest.raises(ConfigError, match=r"^nobody cannot run .*; install orientd where"):
        check_runs(str(closed), Path("/dev/null"), "nobody")
    config = tmp_path / "orientd.toml"
    config.write_text("")
    with pytest.raises(ConfigError, match="nobody-yet cannot run"):
        check_runs(sys.executable, config, "nobody-yet")
    check_runs(sys.executable, config, "root")
