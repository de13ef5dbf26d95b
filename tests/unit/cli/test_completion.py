"""Completions that a shell receives for the Tab key."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import inside

from orientd.cli.main import app

SCRIPT = Path(sys.executable).with_name("orientd")
SCRIPTS = Path(__file__).parents[3] / "config" / "completion"


@pytest.fixture
def completed(folder, monkeypatch, capsys):
    """What bash would be offered for the last of some words."""

    def complete(*words, **more):
        environment = {
            "XDG_RUNTIME_DIR": str(folder),
            "XDG_CONFIG_HOME": str(folder),
            "_ORIENTD_COMPLETE": "bash_complete",
            "COMP_WORDS": " ".join(("orientd", *words)),
            "COMP_CWORD": str(len(words)),
            **more,
        }
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.chdir(folder)
        with pytest.raises(SystemExit) as ended:
            app(prog_name="orientd")
        assert ended.value.code in (0, None)
        return [line.removeprefix("plain,") for line in capsys.readouterr().out.split()]

    return complete


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "turn.yaml").touch()
    (tmp_path / "two.toml").write_text(
        '[devices.left]\ndriver = "loopback"\n[devices.right]\ndriver = "loopback"\n'
    )
    return tmp_path


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["mo"], ["move"]),
        (["move", ""], ["file,"]),  # so the shell completes its files
        (["plan", "--config", "two.toml", "--device", ""], ["left", "right"]),
        (["plot", ""], ["file,"]),
    ],
)
def test_commands_devices_and_files_complete(completed, words, offered):
    assert sorted(completed(*words)) == sorted(offered)


def test_devices_are_those_of_the_configuration_where_no_daemon_answers(folder, completed):
    named = str(folder / "two.toml")
    assert completed("stop", "--device", "r", ORIENTD_CONFIG=named) == ["right"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_command_prints_what_a_shell_evaluates(shell):
    environment = {**os.environ, "_ORIENTD_COMPLETE": f"{shell}_source"}
    printed = subprocess.run(SCRIPT, env=environment, capture_output=True, text=True, check=True)
    assert f"_ORIENTD_COMPLETE={shell}_complete" in printed.stdout


@pytest.mark.parametrize("option", ["--install-completion", "--show-completion"])
def test_options_that_are_gone_say_what_a_shell_needs(option):
    result = inside(option)
    assert result.returncode == 1
    assert "_ORIENTD_COMPLETE=bash_source orientd" in result.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_packaged_file_is_what_the_shell_reads(shell):
    (script,) = (one for one in SCRIPTS.iterdir() if one.suffix == f".{shell}")
    text = script.read_text()
    assert f"_ORIENTD_COMPLETE={shell}_complete" in text
    if shutil.which(shell):
        subprocess.run([shell, "-n", script], check=True)
