"""Choose the plans of the quick stop: which entries of its tables are worth having.

    python tests/bench/tune_quick_stop.py [--motions 30] [--stops 20] [--seed 100]

Motions of every kind and limits are drawn as the tests draw them, from other seeds, and stopped at
random; the stops that the tests know to be hard are among them.  Those count that try more than the
first plan: one in six.  Then each plan of ``PLANS`` and ``BETTER_PLANS``
(:mod:`orientd.servo.path.brake_law`) is taken out of its table, from the last to the first, and put
back where one of those stops then takes more than a tenth, and more than a cycle, longer than the
shortest that was seen, and longer than before.  What is left is printed, and is what the tables
should be.  To try new plans, add them to the tables first.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "unit" / "servo")]

from rides import KINDS, SOME_METHODS, Ride, Track, motions  # noqa: E402 - beside the tests
from shortest_stop import bound  # noqa: E402 - as above

from orientd.servo.path import brake_law  # noqa: E402 - as above
from orientd.servo.path.stop_rollout import StopPlan, StopRollout  # noqa: E402 - as above

MOST = 1.1
"""Times the shortest of all tables that a stop may take for an entry to be left out."""

KNOWN = [
    (7003, 2, "reserve", ["kks_hermite"], (191, 321)),
    (9000, 7, "no reserve", ["kks_hermite"], (4973,)),
    (1, 8, "reserve", SOME_METHODS, (241,)),
    (2, 8, "no reserve", SOME_METHODS, (94,)),
    (8, 14, "at limits", SOME_METHODS, (1571,)),
    (5, 26, "no reserve", SOME_METHODS, (1168,)),
]
"""What test_brake_law.py stops: seed, motions, kind, methods, and records of the last motion."""

TABLES = ("PLANS", "BETTER_PLANS")
Tables = dict[str, tuple[StopPlan, ...]]


@dataclass(eq=False)
class Stop:
    """A stop from one record of a motion: its cycles, the fewest seen, and the plans tried."""

    track: Track
    record: int
    least: float = 0.0
    cycles: int = 0
    fewest: int = 0
    tried: frozenset[StopPlan] = frozenset()

    def ride(self, tables: Tables) -> tuple[int, frozenset[StopPlan]]:
        """Return the cycles of this stop with other tables, and the plans it tried."""
        tried = set()

        class Noted(StopRollout):
            def __init__(self, *place: Any, plan: StopPlan, **options: Any) -> None:
                tried.add(plan._replace(distance=0.0))
                super().__init__(*place, plan=plan, **options)

        kept = {name: getattr(brake_law, name) for name in (*TABLES, "Rehearsal")}
        try:
            for name, plans in tables.items():
                setattr(brake_law, name, plans)
            brake_law.StopRollout = Noted
            ride = Ride(self.track, self.record)
            least = bound(ride.omega, ride.alpha, ride.velocity, ride.motion.limits)
            self.least = min(least, ride.remaining) / ride.motion.period
            cycles = ride.stop()
        finally:
            for name, value in kept.items():
                setattr(brake_law, name, value)
        self.fewest = min(self.fewest or cycles, cycles)
        return cycles, frozenset(tried)

    def suffers(self, cycles: int) -> bool:
        """Whether it takes too long with so many cycles, and longer than it does."""
        return cycles > max(MOST * self.fewest, self.fewest + 1, self.cycles)


def draw(seed: int, count: int, stops: int) -> Iterator[Stop]:
    """Yield the known stops, and random ones of random motions."""
    for known, many, kind, methods, records in KNOWN:
        *_, motion = motions(known, many, kind, methods)
        for record in records:
            yield Stop(Track(motion), record)
    for kind in KINDS:
        random = np.random.default_rng([seed, len(kind)])
        for motion in motions(seed, count, kind):
            track = Track(motion)
            for record in random.integers(4, motion.record_count - 4, stops):
                yield Stop(track, int(record))


def describe(stops: list[Stop]) -> str:
    """Return the statistics of the stops over a bound that knows nothing of the path."""
    ratios = [max(stop.cycles - 1, 0) / stop.least for stop in stops]
    figures = "  ".join(f"{p} % {np.percentile(ratios, p):.3f}" for p in (50, 95, 99, 99.9, 100))
    count = sum(stop.cycles for stop in stops)
    return f"{len(stops)} stops, {count} cycles; of the bound {figures}"


def main() -> None:
    """Draw, prune and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=30, help="of each kind")
    parser.add_argument("--stops", type=int, default=20, help="of each motion")
    parser.add_argument("--seed", type=int, default=100)
    wanted = parser.parse_args()
    tables: Tables = {name: getattr(brake_law, name) for name in TABLES}
    first = tables["PLANS"][0]
    stops, hard = [], []
    for stop in draw(wanted.seed, wanted.motions, wanted.stops):
        stop.cycles, stop.tried = stop.ride(tables)
        if len(stop.tried) > 1:
            hard.append(stop)
        stops.append(stop)
    print(describe(stops), f"\n{len(hard)} of them try more than the first plan", flush=True)
    for name in reversed(TABLES):
        for plan in list(dict.fromkeys(tables[name]))[::-1]:
            if name == "PLANS" and plan == first:
                continue
            rest = {**tables, name: tuple(other for other in tables[name] if other != plan)}
            outcomes = {stop: stop.ride(rest) for stop in hard if plan in stop.tried}
            worse = [f"{s.cycles}>{c[0]}" for s, c in outcomes.items() if s.suffers(c[0])]
            print("kept   " if worse else "dropped", name, plan, *worse, flush=True)
            if not worse:
                tables = rest
                for stop, outcome in outcomes.items():
                    stop.cycles, stop.tried = outcome
    print(describe(stops), *tables.items(), sep="\n")


if __name__ == "__main__":
    main()
