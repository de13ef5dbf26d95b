"""The runs of the night: one that hangs or fails keeps no other from its turn."""

import os
import subprocess
import time
import tomllib
from pathlib import Path

import night
import promises
import pytest

ROOT = Path(night.__file__).parents[1]

RUNS = """# A comment.

[first]
explains = "one"
command = "exit 3"
budget = 5
last_run = "2026-01-01 passed, 1.0 min"

[second]
explains = "two"
command = '''
echo ${WORD:-nothing}
'''
budget = 0.01
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    file = tmp_path / "night.toml"
    file.write_text(RUNS)
    monkeypatch.setattr(night, "FILE", file)
    monkeypatch.setattr(night, "PATIENCE", 0.3)
    dates = tmp_path / "passed_at_night.toml"
    dates.touch()
    monkeypatch.setattr(promises, "AT_NIGHT", dates)
    return file


def test_a_run_that_fails_keeps_the_next_one_from_nothing(file, capfd):
    assert night.main([]) == 1
    table = capfd.readouterr().out
    assert "nothing" in table
    last = {
        name: run["last_run"].split(" ", 1)[1]
        for name, run in tomllib.loads(file.read_text()).items()
    }
    assert last == {"first": "failed, 0.0 min", "second": "passed, 0.0 min"}
    assert [line.split()[0] for line in table.splitlines()[-3:]] == ["run", "first", "second"]


def test_nothing_but_the_date_of_what_ran_changes(file):
    assert night.main(["second"]) == 0
    kept = [line for line in file.read_text().splitlines() if "last_run" not in line]
    assert kept == [line for line in RUNS.splitlines() if "last_run" not in line]
    assert tomllib.loads(file.read_text())["first"]["last_run"] == "2026-01-01 passed, 1.0 min"


def test_a_run_that_is_longer_than_its_budget_ends_with_all_that_it_has_started(file, tmp_path):
    pid = tmp_path / "pid"
    slow = f"trap '' INT; sh -c 'trap \"\" INT; echo $$ > {pid}; sleep 60'; sleep 60"
    begin = time.monotonic()
    assert night.run(slow, 0.5 / 60.0, tmp_path) == "not within 0.00833333 min"
    assert time.monotonic() - begin < 20.0
    child = Path(f"/proc/{int(pid.read_text())}/stat")
    assert not child.exists() or child.read_text().rsplit(")", 1)[1].split()[0] == "Z"


def test_an_unknown_run_is_refused_with_the_names(file, capsys):
    assert night.main(["third"]) == 2
    assert capsys.readouterr().err == "expected some of first, second, got 'third'\n"


def test_every_run_is_a_target_of_make():
    for name in tomllib.loads((ROOT / "tests/night.toml").read_text()):
        told = subprocess.run(
            ["make", "--dry-run", "--no-print-directory", name],
            cwd=ROOT, env=os.environ, capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        assert told.splitlines()[-1].endswith(f"tests/night.py {name}")
