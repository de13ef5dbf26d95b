"""Hours of a whole system in virtual time: a seed determines all events, and reproduces them.

``make hours SEED=1 HOURS=10`` plays rounds of ten minutes each, from a seed on: as shipped, at
500 Hz, and with a device of 50 Hz.  A problem names its seed and when it was;
``make hours SEED=17 HOURS=0.1`` plays that round again.
"""

import logging
import multiprocessing
import os
import time
from collections import Counter
from functools import partial

import pytest
from clients import play
from emulated_system import emulated
from virtual_time import other_process

HOURS = float(os.environ.get("ORIENTD_HOURS", "1"))
SEED = int(os.environ.get("ORIENTD_HOURS_SEED", "1"))
ROUND = 600.0


def played(seed, seconds, name="slow"):
    """Return the problems of a round, what happened in it, and a digest of its history."""
    logging.disable(logging.CRITICAL)
    try:
        with emulated(seed, name) as system:
            play(system, seconds)
            return list(system.problems), system.counts, system.history.hexdigest()
    finally:
        logging.disable(logging.NOTSET)


def processes(count):
    """Return processes for one round each, which take with them what a killed daemon held."""
    return multiprocessing.get_context("fork").Pool(count, maxtasksperchild=1)


@pytest.mark.parametrize(("name", "seconds"), [("slow", 90.0), ("shipped", 30.0)])
def test_whatever_happens_limits_are_kept_and_nothing_is_left_over(name, seconds):
    with processes(1) as pool:
        problems, counts, _ = pool.apply(played, (1, seconds, name))
    assert not problems
    assert counts["outcome_done"]


def test_a_seed_says_all_of_what_happens_in_whichever_process():
    with (
        other_process(played, 3, 20.0, hashes=1, garbage=50) as one,
        other_process(played, 3, 20.0, hashes=2, garbage=100_000) as other,
    ):
        once, again = one.stdout.read(), other.stdout.read()
    assert once
    assert once == again


@pytest.mark.slow
@pytest.mark.timeout(86_400)
@pytest.mark.parametrize("name", ["shipped", "slow"])
def test_hours(name):
    counts, begun, problems = Counter(), time.monotonic(), []
    seeds = range(SEED, SEED + max(1, round(HOURS * 3600.0 / ROUND)))
    with processes(os.cpu_count()) as pool:
        rounds = pool.imap(partial(played, seconds=ROUND, name=name), seeds)
        for done, (found, counted, _) in enumerate(rounds, 1):
            problems += found
            counts += counted
            hours, took = done * ROUND / 3600.0, (time.monotonic() - begun) / 3600.0
            speed = f"{hours:.1f} hours at {hours / took:.0f} times real time"
            print(f"{name}: {speed}, {found or 'well'}", flush=True)
    faults = {kind: counts.pop(kind) for kind in sorted(counts) if kind.startswith("fault: ")}
    print(f"faults: {sum(faults.values())}", {kind[7:]: count for kind, count in faults.items()})
    print(dict(counts))
    assert not problems
