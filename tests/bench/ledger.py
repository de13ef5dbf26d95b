"""What 5,000 requests of fixed seeds cost and bring, beside what the planner did with them before.

In the folder ``tests``::

    python -m bench.ledger                      compare with the stored figures
    python -m bench.ledger --beside FOLDER      and the times with those of another checkout
    python -m bench.ledger --share 0.1          a tenth of the requests of each kind
    python -m bench.ledger --write FILE         what is stored, of the planner as it is now

Of each request: its duration, the processor time of its plan, how many timings and certificates it
took, the attempt that won, the refusal, and the longest stop.  The stored file has those of commit
ace8ce78 without the processor time, and the states from which retargets begin.

Only what that commit has is called.  Its environment may run this file: see ``--beside``.
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np

from orientd import kernels
from orientd.planner.certify import measuring

STORED = Path(__file__).resolve().parents[1] / "data" / "ledger.npz"
COUNTS = {
    **dict.fromkeys(("rest", "one end", "both ends", "times", "positions", "duration"), 400),
    "near duplicates": 300,
    "even": 300,
    "even C1": 400,
    "retarget": 500,
    "blend": 400,
    "arm": 250,
    "gimbal": 250,
    "cone": 200,
}
"""Requests of each kind."""

TIMINGS = ("time_quickest", "time_even", "choose_knots")
called: Counter[str] = Counter()
won: list[str] = []


def _counted(module: Any, name: str) -> None:
    """Count the calls of a function; those that only look at a path have no tolerance."""
    function = getattr(module, name, None)
    if function is None:
        return

    def counted(*given: Any, **more: Any) -> Any:
        called["looks" if name == "measure" and not more.get("tolerance") else name] += 1
        return function(*given, **more)

    setattr(module, name, counted)


# Before the planner takes them by their names.
for _kernel in TIMINGS:
    _counted(kernels, _kernel)
_counted(measuring, "measure")

from bench.following_requests import blends  # noqa: E402
from bench.single_requests import plans, quickest_turns  # noqa: E402

from orientd.driver import AxisLimits  # noqa: E402
from orientd.errors import PlanError, RequestError  # noqa: E402
from orientd.keep_out import KeepOut  # noqa: E402
from orientd.mechanism.gimbal import Gimbal  # noqa: E402
from orientd.model.limits import Limits  # noqa: E402
from orientd.model.request import Keyframe, MotionRequest  # noqa: E402
from orientd.planner import planning  # noqa: E402
from orientd.planner.blending import blend  # noqa: E402
from orientd.planner.device_planner import DevicePlanner  # noqa: E402
from orientd.planner.motion import Motion  # noqa: E402
from orientd.planner.planning import plan  # noqa: E402
from orientd.planner.state import State  # noqa: E402
from orientd.rotation import exp, multiply  # noqa: E402
from orientd_ur.arm import MODELS  # noqa: E402

PERIOD = 0.002
DEVICES = (
    Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    Limits(1.0, 3.0, 40.0, 0.5, 5.0),
    Limits(0.3, 0.4, 5.0, 0.2, 0.5),
    Limits(10.0, 200.0, 3e4, 3.0, 30.0),
)
C1 = (
    "squad", "kks_hermite_spline", "bezier_catmull_rom", "schlag_catmull_rom", "circular_blending",
    "nielson_shieh",
)  # fmt: skip

Work = Callable[[], tuple[Motion, float]]
"""Plans; returns the motion, and the seconds before it begins."""


def _note_attempts() -> None:
    """Note the name of the attempt whose motion is used, as far as the planner has attempts."""
    certified = getattr(planning, "_certified", None)
    if certified is None:
        return

    def noted(made: Any, *given: Any) -> Motion:
        motion = certified(made, *given)
        won.append(made.attempt.name)
        return motion

    planning._certified = noted


def single(seed: int, kind: str) -> Work:
    """Return the plan of one request of the generators."""
    case = plans(seed, "rest" if kind.startswith(("even", "cone")) else kind)
    request = case.request
    if kind == "duration":
        keys = np.array([one.q for one in request.keyframes])
        turns, speed_up = quickest_turns(keys, case.limits), 10.0 * case.limits.velocity
        least = float(turns.sum()) + speed_up / case.limits.acceleration
        request = replace(request, duration=case.factor * least)
    elif kind == "even":
        request = replace(request, pace="even")
    elif kind == "even C1":
        request = replace(request, pace="even", method=C1[seed // len(DEVICES) % len(C1)])
    elif kind == "cone":
        random = np.random.default_rng([seed, 1])
        direction = random.normal(size=3)
        direction = tuple((direction / np.linalg.norm(direction)).tolist())
        cone = KeepOut("laser", direction, float(random.uniform(0.05, 0.5)), 0.02)
        request = replace(request, keep_out=[cone])
    return lambda: (plan(request, start=case.start, limits=case.limits, period=PERIOD), 0.0)


def retarget(row: np.ndarray, seed: int) -> Work:
    """Return the plan of a request for a device that moves."""
    random = np.random.default_rng([seed, 2])
    limits, parts = DEVICES[int(row[0])], np.split(row[1:], [4, 7, 10, 13, 16, 19, 31])
    start = State(*parts[:6], before=(parts[6].reshape(3, 4), parts[7].reshape(3, 3)))
    extra = {}
    if seed % 5 == 4:
        extra["start_velocity"] = _vector(random, limits.velocity * random.uniform(0.05, 0.7))
    count = 1 if seed % 5 < 2 else int(random.integers(2, 7))
    keyframes = _keyframes(random, start.q, random.uniform(0.02, 2.5), count)
    request = MotionRequest(keyframes, approach=True, **extra)
    return lambda: (plan(request, start=start, limits=limits, period=PERIOD), 0.0)


def blended(case: Any) -> Work:
    """Return the plan of the second of two motions; the first one is planned before."""
    first = plan(case.requests[0], start=case.start, limits=case.limits, period=case.period)
    earliest = int(case.passed[0] * first.record_count)

    def work() -> tuple[Motion, float]:
        leave, motion = blend(
            first.recorded(), case.requests[1], tolerance=case.tolerances[0], limits=case.limits,
            period=case.period, earliest=earliest,
        )  # fmt: skip
        return motion, case.period * leave

    return work


def of_device(seed: int, kind: str) -> Work:
    """Return the plan of a request for an arm or a gimbal."""
    random = np.random.default_rng([seed, 3])
    if kind == "gimbal":
        axes = [
            AxisLimits(name, -4.7, 4.7, *map(float, random.uniform((1.5, 10.0), (5.0, 60.0))))
            for name in ("yaw", "pitch", "roll")
        ]
        deviation = 0.02 * (seed % 4 > 1)
        mechanism = Gimbal(axes, order="ZYX", allow_slews=seed % 2 == 0, max_deviation=deviation)
        period, joints = 0.01, tuple(random.uniform(-1, 1, 3).tolist())
        start = State.at_rest(np.array(mechanism.orientation(joints)), (0.0, 0.0, 0.0))
    else:
        mechanism, period = MODELS["ur5e"].arm().slower(15.0), PERIOD
        usual = np.array([0.0, -1.6, 1.6, -1.6, -1.6, 0.0])
        joints = tuple((usual + random.uniform(-0.5, 0.5, 6)).tolist())
        q, place = mechanism.forward(joints)
        start = State.at_rest(np.array(q), place)
    keyframes = _keyframes(random, start.q, random.uniform(0.1, 1.2), int(random.integers(1, 4)))
    request = MotionRequest(keyframes, approach=True)
    driver = SimpleNamespace(name="ledger", mechanism=lambda *, may_ask: mechanism)
    planner = DevicePlanner(driver, limits=DEVICES[0], period=period)
    return lambda: (planner.plan(request, start=start, joints=joints), 0.0)


def _vector(random: np.random.Generator, size: float) -> tuple[float, ...]:
    direction = random.normal(size=3)
    return tuple((size * direction / np.linalg.norm(direction)).tolist())


def _keyframes(random: np.random.Generator, q: Any, step: float, count: int) -> list[Keyframe]:
    found = []
    for _ in range(count):
        q = multiply(q, exp(np.array(_vector(random, step * random.uniform(0.1, 1.0)))))
        found.append(Keyframe(tuple(q.tolist())))
    return found


def states(count: int) -> np.ndarray:
    """Return states of random motions at random records: device, state and the records before."""
    random, rows = np.random.default_rng(2), []
    while len(rows) < count:
        device = len(rows) % len(DEVICES)
        q = exp(np.array(_vector(random, random.uniform(0.0, 3.0))))
        start = State.at_rest(q, random.uniform(-1, 1, 3))
        keyframes = _keyframes(random, q, random.uniform(0.1, 2.0), int(random.integers(1, 4)))
        request = MotionRequest(keyframes, approach=True)
        motion = plan(request, start=start, limits=DEVICES[device], period=PERIOD)
        one = motion.recorded().state_at(int(random.integers(3, motion.record_count)))
        if not one.is_at_rest:
            parts = one.q, one.omega_body, one.alpha_body, one.position, one.velocity
            before = np.concatenate([np.ravel(part) for part in one.before])
            rows.append(np.concatenate([[device], *parts, one.acceleration, before]))
    return np.array(rows)


def works(kind: str, count: int, moving: np.ndarray) -> list[Callable[[], Work]]:
    """Return what prepares each request of a kind."""
    if kind == "blend":
        return [partial(blended, case) for case in islice(blends(7), count)]
    if kind == "retarget":
        return [partial(retarget, one, seed) for seed, one in enumerate(moving[:count])]
    make = of_device if kind in ("arm", "gimbal") else single
    return [partial(make, seed, kind) for seed in range(count)]


def row(kind: str, prepare: Callable[[], Work]) -> dict[str, Any]:
    """Plan one request, and return its line of the ledger."""
    found: dict[str, Any] = {"kind": kind, "duration": np.nan, "stop": np.nan, "refused": ""}
    begun = time.thread_time()
    try:
        work = prepare()
        called.clear()
        won.clear()
        begun = time.thread_time()
        motion, before = work()
    except (PlanError, RequestError) as error:
        found["refused"] = f"{type(error).__name__}: {error}"[:160]
    else:
        found |= {"duration": before + motion.duration, "stop": motion.certificate.stop_time}
    found["cpu"] = time.thread_time() - begun
    found |= {"plans": called["measure"], "timings": sum(called[name] for name in TIMINGS)}
    return found | {"won": won[-1] if won else ""}


def ledger(share: float, moving: np.ndarray) -> list[dict[str, Any]]:
    """Return the lines of all requests, or of the first of each kind."""
    warnings.simplefilter("ignore")
    _note_attempts()
    single(0, "rest")()  # what the first one loads
    counts = {kind: round(share * count) for kind, count in COUNTS.items()}
    return [row(kind, one) for kind, n in counts.items() for one in works(kind, n, moving)]


def table(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the comparison of two ledgers, a line for each kind."""
    yield (
        f"{'kind':16}{'n':>5}  {'duration p50 p99 max':22}{'stop p50 p90 max':22}"
        f"{'certificates':15}{'at most':11}{'ms':15}newly refused, planned"
    )
    for kind in [*COUNTS, "all"]:
        pairs = [(a, b) for a, b in zip(before, now, strict=True) if kind in ("all", a["kind"])]
        took = [b["duration"] / a["duration"] for a, b in pairs]
        stops = [b["stop"] / a["stop"] for a, b in pairs if a["stop"] > 0.0]
        names = "plans", "cpu", "refused"
        sides = [[[one[k] for one in side] for k in names] for side in zip(*pairs, strict=True)]
        (a, x, lost), (b, y, gained) = sides
        changed = [bool(p) - bool(q) for p, q in zip(lost, gained, strict=True)]
        yield (
            f"{kind:16}{len(pairs):5}  {_quantiles(took, 0.5, 0.99, 1.0):22}"
            f"{_quantiles(stops, 0.5, 0.9, 1.0):22}{np.mean(a):5.2f} > {np.mean(b):5.2f}  "
            f"{max(a):3} > {max(b):3}  {1e3 * np.median(x):5.2f} > {1e3 * np.median(y):5.2f}  "
            f"{changed.count(-1):4} {changed.count(1):4}"
        )
    attempts = Counter(one["won"] for one in now if one["won"])
    yield f"attempts that won: {dict(attempts.most_common())}"
    refused = Counter(re.sub(r"[-+.e\d]*\d", "#", one["refused"])[:70] for one in now)
    yield from (f"refused {count}: {words}" for words, count in refused.most_common(8) if words)
    yield from (
        f"newly refused: {a['kind']} {index}: {b['refused']}"
        for index, (a, b) in enumerate(zip(before, now, strict=True))
        if b["refused"] and not a["refused"]
    )


def _quantiles(values: list[float], *shares: float) -> str:
    found = np.array(values)[np.isfinite(values)]
    return " ".join(f"{one:.4f}" for one in np.quantile(found, shares)) if len(found) else "-"


def stored(share: float) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Return the stored lines of these requests, and the states of the retargets."""
    with np.load(STORED) as known:
        columns = {name: known[name].tolist() for name in known.files if name != "states"}
        moving = known["states"]
    lines = [dict(zip(columns, one, strict=True)) for one in zip(*columns.values(), strict=True)]
    firsts = {kind: iter([one for one in lines if one["kind"] == kind]) for kind in COUNTS}
    wanted = [islice(firsts[kind], round(share * n)) for kind, n in COUNTS.items()]
    return [one | {"cpu": np.nan, "won": ""} for some in wanted for one in some], moving


@click.command()
@click.option("--share", default=1.0, help="Of the requests of each kind.")
@click.option("--beside", type=click.Path(exists=True, path_type=Path), help="A checkout.")
@click.option("--write", type=click.Path(path_type=Path), help="A file for the figures, .npz.")
@click.option("--lines", type=click.Path(path_type=Path), hidden=True)
def main(share: float, beside: Path | None, write: Path | None, lines: Path | None) -> None:
    """Plan all requests, and compare them with what was stored."""
    if write is not None:
        moving = states(COUNTS["retarget"])
        found = ledger(1.0, moving)
        names = ("kind", "duration", "stop", "plans", "timings", "refused")
        np.savez_compressed(
            write, states=moving, **{name: np.array([one[name] for one in found]) for name in names}
        )
        return
    before, moving = stored(share)
    now = ledger(share, moving)
    if lines is not None:
        lines.write_text(json.dumps(now))
        return
    if beside is not None:
        with tempfile.NamedTemporaryFile() as file:
            python = beside / ".venv" / "bin" / "python"
            command = [python, "-m", "bench.ledger", "--share", str(share), "--lines", file.name]
            subprocess.run(command, check=True, cwd=STORED.parents[1])
            before = json.loads(Path(file.name).read_text())
    print("\n".join(table(before, now)))


if __name__ == "__main__":
    main()
