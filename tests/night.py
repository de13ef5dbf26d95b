"""Run what takes too long for `make test`, each with a time-out; see night.toml.

::

    python tests/night.py [NAME ...]

goes on after a failure, prints a table at the end, and writes the dates into night.toml, and those
of tests that hold a promise into passed_at_night.toml.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
FILE = Path(__file__).with_name("night.toml")

PATIENCE = 30.0
"""Time that a run has to end by itself after its time-out, s."""


def run(command: str, minutes: float, folder: Path) -> str:
    """Return how a command of a shell ends; its tests note in *folder* that they passed."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    shell = subprocess.Popen(
        ["sh", "-c", command],
        cwd=ROOT,
        env={**os.environ, "PATH": path, "TESTS_THAT_PASSED": str(folder)},
        process_group=0,
    )
    try:
        status = shell.wait(60.0 * minutes)
    except (subprocess.TimeoutExpired, KeyboardInterrupt) as error:
        _end(shell)
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"not within {minutes:g} min"
    return "failed" if status else "passed"


def settings(run: dict[str, Any]) -> str:
    """Return the variables that this run was given, which its command or explanation names."""
    names = dict.fromkeys(re.findall(r"[A-Z][A-Z_]{3,}", run["command"] + run["explains"]))
    return "".join(f", {name}={os.environ[name]}" for name in names if name in os.environ)


def _end(shell: subprocess.Popen[bytes]) -> None:
    """End a shell with all that it has started: as Ctrl-C does, and then for certain."""
    for number in (signal.SIGINT, signal.SIGKILL):
        try:
            os.killpg(shell.pid, number)
            shell.wait(PATIENCE)
        except (ProcessLookupError, subprocess.TimeoutExpired):
            continue


def note(text: str, name: str, outcome: str) -> str:
    """Return the content of night.toml with another date and outcome of one run."""
    head, table, rest = re.split(rf"^(\[{name}\]\n)", text, maxsplit=1, flags=re.MULTILINE)
    inside, *others = re.split(r"^(?=\[)", rest, maxsplit=1, flags=re.MULTILINE)
    line = f'last_run = "{datetime.now(UTC):%Y-%m-%d} {outcome}"\n'
    inside = re.sub(r"^last_run = .*\n", "", inside, flags=re.MULTILINE)
    inside = re.sub(r"^(budget = .*\n)", rf"\1{line}", inside, flags=re.MULTILINE)
    return "".join([head, table, inside, *others])


def note_promises(folder: Path) -> None:
    """Write into a file of promises.py which of their tests passed today."""
    import promises  # it needs the environment that the runs need, and --list does not

    ledger = tomllib.loads(promises.FILE.read_text(encoding="utf-8"))
    lines = promises.places(ledger)
    named = {test for _, _, tests in lines for test in promises.tests_of_promise(tests)}
    text = promises.AT_NIGHT.read_text(encoding="utf-8")
    dates = dict.fromkeys(promises.passed(folder) & named, f"{datetime.now(UTC):%Y-%m-%d}")
    rows = sorted((tomllib.loads(text) | dates).items())
    comments = [line for line in text.splitlines() if line.startswith("#")]
    said = [*comments, *(f'"{test}" = "{date}"' for test, date in rows if test in named)]
    promises.AT_NIGHT.write_text("\n".join(said) + "\n", encoding="utf-8")


def main(names: list[str]) -> int:
    """Run the runs of some names, by default all; return the exit status."""
    runs: dict[str, dict[str, Any]] = tomllib.loads(FILE.read_text(encoding="utf-8"))
    if names == ["--list"]:
        rows = [{"name": name, "minutes": run["budget"] + 15} for name, run in runs.items()]
        print(json.dumps(rows))
        return 0
    unknown = [name for name in names if name not in runs]
    if unknown:
        print(f"expected some of {', '.join(runs)}, got {unknown[0]!r}", file=sys.stderr)
        return 2
    lines, is_good = [f"{'run':10}{'minutes':>9}{'budget':>9}  outcome"], True
    for name in names or runs:
        budget = float(os.environ.get("BUDGET") or runs[name]["budget"])
        print(f"{name}: {runs[name]['explains']}", flush=True)
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            outcome = run(runs[name]["command"], budget, Path(folder))
            note_promises(Path(folder))
        took = (time.monotonic() - begin) / 60.0
        is_good &= outcome == "passed"
        lines.append(f"{name:10}{took:9.1f}{budget:9g}  {outcome}")
        outcome = f"{outcome}, {took:.1f} min{settings(runs[name])}"
        said = note(FILE.read_text(encoding="utf-8"), name, outcome)
        FILE.write_text(said, encoding="utf-8")
    print("\n".join(lines))
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
