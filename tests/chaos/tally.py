"""Write the results of the chaos tests: a file for each fault, and the table in the docs.

`make chaos` leaves its results in ``build/chaos``.  ``python tests/chaos/tally.py`` gathers them
into ``tests/chaos/results.json`` and writes the table between its markers.
"""

from __future__ import annotations

import json
import os
import random
import re
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("ORIENTD_CHAOS_DIR", ROOT / "build" / "chaos"))
RESULTS = Path(__file__).with_name("results.json")
PAGE = ROOT / "docs" / "explanation" / "faults.md"
BEGIN, END = "<!-- chaos:begin -->", "<!-- chaos:end -->"

ROUNDS = int(os.environ.get("ORIENTD_CHAOS_ROUNDS", "50"))
SEED = int(os.environ.get("ORIENTD_CHAOS_SEED", "1"))
ONLY = os.environ.get("ORIENTD_CHAOS_ONLY", "")
"""Number of a single round to run, from the message of a failure."""


@dataclass
class Broken:
    """A round in which a check failed."""

    number: int
    what: str


@dataclass
class Tally:
    """All rounds of one fault.

    Attributes:
        fault: its name in the table.
        order: its place in the table.
        claims: the checks, as text.
        seed: with the fault's name and the round's number, the seed of every random choice.
        rounds: number of rounds so far.
        met: the events, and the number of each.
        slowest: name and duration in s of the slowest call, except the first motion of a daemon.
        broken: the rounds in which a check failed.
        skipped: the reason if the fault cannot be tried, otherwise empty.
    """

    fault: str
    order: int
    claims: str
    seed: int = SEED
    rounds: int = 0
    met: Counter[str] = field(default_factory=Counter)
    slowest: tuple[str, float] = ("", 0.0)
    broken: list[Broken] = field(default_factory=list)
    skipped: str = ""

    def skip(self, name: str, why: str) -> None:
        """Write the reason why the fault cannot be tried, and skip the test."""
        self.skipped = why
        self.keep(name)
        pytest.skip(why)

    def keep(self, name: str) -> None:
        """Write the tally to its file."""
        FOLDER.mkdir(parents=True, exist_ok=True)
        path = FOLDER / f"{self.order:02d}-{name}.json"
        path.write_text(json.dumps(vars(self), indent=1, default=vars) + "\n")


def rounds_of(
    name: str, tally: Tally, one: Callable[[int, random.Random], object], *, rounds: int = ROUNDS
) -> None:
    """Run *one* for every round, also after a failed one, and report the failures at the end.

    Args:
        name: name of the fault, part of every seed.
        tally: its results so far.
        one: runs a round, and raises an error if a check fails.
        rounds: number of rounds.

    Raises:
        AssertionError: a check failed in one of the rounds.
    """
    for number in [int(ONLY)] if ONLY else range(rounds):
        tally.rounds += 1
        try:
            one(number, random.Random(f"{name}/{tally.seed}/{number}"))
        except Exception as error:  # noqa: BLE001 - every error is a result
            where = traceback.extract_tb(error.__traceback__)[-1]
            what = str(error).split("debug_error_string")[0] or str(where.line)
            tally.broken.append(Broken(number, f"{type(error).__name__}: {what}"[:600]))
            print(f"\n{name} round {number}:")
            traceback.print_exc()
        if not ONLY:
            tally.keep(name)
    print(
        f"\n{name}: {tally.rounds} rounds, {len(tally.broken)} broken, slowest "
        f"{tally.slowest[0]} {tally.slowest[1]:.3f} s, {dict(tally.met)}"
    )
    assert not tally.broken, tally.broken


def table(results: list[dict]) -> str:
    """Return the table of `docs/explanation/faults.md`."""
    lines = [
        "| fault | rounds | checks that held | failures |",
        "|---|---|---|---|",
    ]
    for result in results:
        if result["skipped"]:
            lines.append(f"| {result['fault']} | not tried | | {result['skipped']} |")
            continue
        kept = result["rounds"] - len(result["broken"])
        met = ", ".join(f"{what} ({count})" for what, count in sorted(result["met"].items()))
        name, seconds = result["slowest"]
        slowest = f". Slowest answer {seconds:.2f} s (`{name}`)" if name else ""
        held = f"{result['claims']}: {kept} of {result['rounds']}{slowest}"
        if met:
            held += f". Observed: {met}"
        kinds = Counter(_gist(broken["what"]) for broken in result["broken"])
        bad = "; ".join(f"{what} ({count})" for what, count in kinds.most_common(3)) or "none"
        lines.append(f"| {result['fault']} | {result['rounds']} | {held} | {bad} |")
    return "\n".join(lines)


def _gist(what: str) -> str:
    """Return the message of a failure: that of a call's error or of a motion's end, if any."""
    words = re.search(r'(?:details = |text: )"([^"]+)"', what)
    text = words.group(1) if words else what.split("\n")[0].split(": ", 1)[-1]
    return text[:110].replace("|", "/")


def main() -> None:
    """Gather the results and write the table."""
    known = {r["fault"]: r for r in json.loads(RESULTS.read_text())} if RESULTS.exists() else {}
    for path in sorted(FOLDER.glob("*.json")):
        result = json.loads(path.read_text())
        known[result["fault"]] = result
    results = sorted(known.values(), key=lambda result: (result["order"], result["fault"]))
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    PAGE.write_text(f"{before}{BEGIN}\n{table(results)}\n{END}{after}")


if __name__ == "__main__":
    main()
