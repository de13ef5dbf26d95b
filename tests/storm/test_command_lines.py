"""Command lines of nonsense: each is done, refused or a mistake in the command line, in words.

Run with `make storm`; fewer of them: ORIENTD_STORM_LINES=1000.
"""

import os
import random
from collections import Counter

import pytest
from command_line import inside
from mutations import damaged_file, seeds

from orientd.cli.main import app

LINES = int(os.environ.get("ORIENTD_STORM_LINES", "10000"))
SEED = int(os.environ.get("ORIENTD_STORM_SEED", "1"))

# Commands that run until a signal, write outside the folder or take minutes.
BEYOND = {"run", "sim", "view", "demo", "bench", "service", "doctor", "batch"}
LENGTHY = {"--gallery", "--jobs", "--help"}
WILD = (
    *("", "-", "--", "0", "-1", "nan", "inf", "1e309", "1e-320", "9" * 400, "0x10", "true", "arm"),
    *("/dev/zero", "/dev/null", ".", "/", "nowhere", "nowhere/at/all.svg", "a" * 5000, "\udcff"),
    *("\x1b[2J", "\U0001f600", "a\nb", "--json", "-d", "=", "*", "%s", "{}", "127.0.0.1:1", "é"),
)


def words(chance, command, files):
    """Return arguments for a command: known options, each with a value or without, and more."""
    found = app.get_command(None, command)
    options = [
        option
        for parameter in found.params
        for option in parameter.opts
        if option.startswith("-") and option not in LENGTHY
    ]
    said = [command]
    for _ in range(chance.choice((0, 1, 2, 4))):
        if options and chance.random() < 0.5:
            said.append(chance.choice(options))
        said.append(chance.choice((*WILD, *files)))
    return said


def rehearse(folder, count, seed, monkeypatch):
    monkeypatch.chdir(folder)
    for name in ("XDG_CONFIG_HOME", "XDG_RUNTIME_DIR", "XDG_STATE_HOME", "HOME"):
        monkeypatch.setenv(name, str(folder))
    monkeypatch.setenv("ORIENTD_SOCKET", str(folder / "none.sock"))
    whole, found = seeds(folder), Counter()
    os.mkfifo(folder / "fifo.csv")
    commands = sorted(set(app.list_commands(None)) - BEYOND)
    for number in range(count):
        chance = random.Random(f"{seed} {number}")
        source = chance.choice(whole)
        damaged_file(source, folder / f"damaged{source.suffix}", chance)
        files = (str(source), str(folder / f"damaged{source.suffix}"), "fifo.csv")
        line = words(chance, chance.choice(commands), files)
        done = inside(*line)
        assert done.returncode in (0, 1, 2), (number, line)
        assert "orientd's own" not in done.stderr, (number, line, done.stderr)
        assert "Traceback" not in done.stderr, (number, line, done.stderr)
        assert "\x1b" not in done.stderr, (number, line, done.stderr)
        if done.returncode:
            assert done.stderr, (number, line)
        found[done.returncode] += 1
    return found


pytestmark = pytest.mark.filterwarnings("ignore:.*more than a whole turn")


def test_some_command_lines_of_nonsense_are_refused_in_words(tmp_path, monkeypatch):
    found = rehearse(tmp_path, 60, SEED, monkeypatch)
    assert found[1]
    assert found[2]


@pytest.mark.storm
@pytest.mark.timeout(0)
def test_command_lines_of_nonsense_are_refused_in_words(tmp_path, monkeypatch):
    found = rehearse(tmp_path, LINES, SEED, monkeypatch)
    print(f"{LINES} command lines: {found}")
    assert found[1]
    assert found[2]
