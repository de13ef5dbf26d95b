"""Completions that a shell receives for the Tab key."""

import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import inside

from orientd.cli.main import app
from orientd.curves import METHODS

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
        (["plot", "kks_h"], [name for name in METHODS if name.startswith("kks_h")]),
    ],
)
def test_commands_devices_and_families_complete(completed, words, offered):
    assert sorted(completed(*words)) == sorted(offered)


def test_devices_are_those_of_the_configuration_where_no_daemon_answers(folder, completed):
    named = str(folder / "two.toml")
    assert completed("stop", "--device", "r", ORIENTD_CONFIG=named) == ["right"]


@pytest.mark.parametrize(
    ("shell", "start", "place"),
    [
        ("bash", ".bashrc", ".bash_completions/orientd.sh"),
        ("zsh", ".zshrc", ".zfunc/_orientd"),
        ("fish", None, ".config/fish/completions/orientd.fish"),
    ],
)
def test_a_shell_is_taught_once(shell, start, place, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", f"/usr/bin/{shell}")
    for _ in range(2):
        assert inside("--install-completion").returncode == 0
    assert (tmp_path / place).read_text() == inside("--show-completion").stdout.rstrip("\n") + "\n"
    assert start is None or len((tmp_path / start).read_text().split("\n")) == 3


def test_a_shell_without_completion_is_named(monkeypatch):
    monkeypatch.setenv("SHELL", "/bin/tcsh")
    assert "got 'tcsh'" in inside("--show-completion").stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_packaged_file_is_what_the_shell_reads(shell):
    (script,) = (one for one in SCRIPTS.iterdir() if one.suffix == f".{shell}")
    text = script.read_text()
    assert f"_ORIENTD_COMPLETE={shell}_complete" in text
    if shutil.which(shell):
        subprocess.run([shell, "-n", script], check=True)
