"""Random policies: chunks of poses that come late, out of order, and contradict each other."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import dataclass, field

from orientd.driver import Quaternion, Vector3
from orientd.floats import combine, difference, exp, multiply, norm, plus

SECONDS = 3.0
"""How long a policy runs, s."""

POSITION = 0.05
"""How far a policy moves the tool, m."""

HABITS = ("anchors", "outliers", "contradictions", "signs", "repeats", "nothings", "positions")
"""A policy has about a third of them."""

ANCHOR, OUTLIER = 0.07, 0.03
"""Largest shift of a whole chunk, rad, and share of the poses that are anywhere."""

STEP = 0.01
"""Between two instants at which the asked motion is added up, s."""


@dataclass
class Chunk:
    """Poses as they are sent.

    Attributes:
        arrives: when, s since the policy began.
        times: of the poses, s.
        poses: orientations.
        positions: m; ``None`` if the policy has none.
    """

    arrives: float
    times: list[float]
    poses: list[Quaternion]
    positions: list[Vector3] | None


@dataclass
class Policy:
    """A random policy.

    Attributes:
        seed: makes the same policy again.
        hz: poses a second.
        count: poses of a chunk.
        inference: age of an observation when its chunk is sent, s.
        jitter: by how much longer it may take, s.
        loss: share of lost poses, and of lost chunks.
        habits: some of :data:`HABITS`.
        limits: of the session: velocity, acceleration and jerk.
        chunks: by arrival.  The last one is whole and in time.
    """

    seed: int
    hz: float = 0.0
    count: int = 0
    inference: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    habits: set[str] = field(default_factory=set)
    limits: dict[str, float] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)

    def __str__(self) -> str:
        limits = "/".join(f"{limit:.3g}" for limit in self.limits.values())
        return (
            f"seed {self.seed}: {self.count} poses at {self.hz:.0f} Hz, {self.inference:.2f} s and "
            f"up to {1e3 * self.jitter:.0f} ms, {self.loss:.0%} lost, limits {limits}, "
            f"{len(self.chunks)} chunks, {' '.join(sorted(self.habits))}"
        )


def policy(seed: int, start: Quaternion, place: Vector3) -> Policy:
    """Return the policy of a *seed* for a device that rests at *start* and *place*, m."""
    chance = random.Random(seed)
    acceleration = chance.uniform(3.0, 17.0)
    found = Policy(
        seed,
        hz=chance.uniform(5.0, 60.0),
        count=chance.randint(4, 64),
        inference=chance.uniform(0.0, 1.0),
        jitter=chance.uniform(0.0, 0.08),
        loss=chance.uniform(0.0, 0.3),
        habits={habit for habit in HABITS if chance.random() < 0.35},
        limits={
            "velocity": chance.uniform(0.5, 2.5),
            "acceleration": acceleration,
            "jerk": acceleration * 10.0 ** chance.uniform(1.0, 2.6),
        },
    )
    _Poses(found, chance, start, place).fill()
    return found


class _Poses:
    """Makes the chunks of a policy."""

    def __init__(
        self, wanted: Policy, chance: random.Random, start: Quaternion, place: Vector3
    ) -> None:
        self._policy, self._chance = wanted, chance
        self._start, self._place = start, place
        self._axes = [_direction(chance) for _ in range(3)]
        self._swing = chance.uniform(0.05, 1.0)
        self._spin = 2.0 * math.pi * chance.uniform(0.05, 0.7)

    def fill(self) -> None:
        """Add the chunks."""
        wanted, chance = self._policy, self._chance
        length = wanted.count / wanted.hz
        every = chance.choice([wanted.inference, 0.5 * length, length + wanted.inference])
        every = max(every, 0.05)
        sent = [self._chunk(k * every) for k in range(math.ceil(SECONDS / every))]
        sent = [chunk for chunk in sent if chunk.poses and chance.random() >= wanted.loss]
        sent = sorted(sent, key=lambda chunk: chunk.arrives)
        last = max([SECONDS, *(chunk.arrives for chunk in sent)]) + 0.01
        times = [last + 0.15 + k / wanted.hz for k in range(min(wanted.count, 16))]
        wanted.chunks = [*sent, self._whole(last, times)]

    def _chunk(self, observed: float) -> Chunk:
        wanted, chance, habits = self._policy, self._chance, self._policy.habits
        times = [observed + k / wanted.hz for k in range(wanted.count)]
        times = [when for when in times if chance.random() >= wanted.loss]
        if "repeats" in habits and times:
            times.insert(0, times[0])
        arrives = observed + wanted.inference + chance.uniform(0.0, wanted.jitter)
        chunk = self._whole(arrives, times)
        shift = (1.0, 0.0, 0.0, 0.0)
        if "anchors" in habits:
            shift = multiply(shift, exp(_any(chance, ANCHOR)))
        if "contradictions" in habits and chance.random() < 0.3:
            shift = multiply(shift, exp(_any(chance, 1.0)))
        chunk.poses = [self._spoilt(multiply(q, shift)) for q in chunk.poses]
        return chunk

    def _spoilt(self, q: Quaternion) -> Quaternion:
        chance, habits = self._chance, self._policy.habits
        if "outliers" in habits and chance.random() < OUTLIER:
            q = multiply(q, exp(_any(chance, math.pi)))
        if "signs" in habits and chance.random() < 0.5:
            w, x, y, z = q
            q = (-w, -x, -y, -z)
        if "nothings" in habits and chance.random() < 0.05:
            q = chance.choice([(math.nan,) * 4, (0.0,) * 4, (0.5, 0.0, 0.0, 0.0)])
        return q

    def _whole(self, arrives: float, times: list[float]) -> Chunk:
        positions = None
        if "positions" in self._policy.habits:
            positions = [self._position(when) for when in times]
        return Chunk(arrives, times, [self._pose(when) for when in times], positions)

    def _pose(self, t: float) -> Quaternion:
        first, second, _ = self._axes
        swing, spin = self._swing, self._spin
        turn = exp(combine(first, swing * math.sin(spin * t), first, 0.0))
        along = 0.5 * swing * (1.0 - math.cos(0.7 * spin * t))
        return multiply(self._start, multiply(turn, exp(combine(second, along, second, 0.0))))

    def _position(self, t: float) -> Vector3:
        return plus(self._place, self._axes[2], POSITION * math.sin(self._spin * t))


def asked_turn(chunks: list[Chunk], start: Quaternion) -> float:
    """Return how far a device turns that goes straight from pose to pose, rad, from *start* on.

    A chunk replaces what is left of the one before as soon as it arrives.
    """
    whole, q, present = 0.0, start, None
    coming = [chunk for chunk in chunks if chunk.poses]
    end = coming[-1].times[-1]
    for k in itertools.count(math.floor(coming[0].arrives / STEP)):
        now = k * STEP
        while coming and coming[0].arrives <= now:
            chunk = coming.pop(0)
            if chunk.times[-1] > now:
                present = _points(chunk)
        if present is not None:
            there = _between(present, now)
            whole += norm(difference(q, there))
            q = there
        if now > end:
            return whole
    raise AssertionError("a policy ends")


def _points(chunk: Chunk) -> list[tuple[float, Quaternion]]:
    pairs = zip(chunk.times, chunk.poses, strict=True)
    return [(when, q) for when, q in pairs if abs(sum(x * x for x in q) - 1.0) < 1e-6]


def _between(points: list[tuple[float, Quaternion]], now: float) -> Quaternion:
    for (before, here), (after, there) in itertools.pairwise(points):
        if before <= now < after:
            turn, share = difference(here, there), (now - before) / (after - before)
            return multiply(here, exp(plus((0.0, 0.0, 0.0), turn, share)))
    return points[0][1] if now < points[0][0] else points[-1][1]


def _direction(chance: random.Random) -> Vector3:
    vector = (chance.gauss(0.0, 1.0), chance.gauss(0.0, 1.0), chance.gauss(0.0, 1.0))
    return plus((0.0, 0.0, 0.0), vector, 1.0 / norm(vector))


def _any(chance: random.Random, most: float) -> Vector3:
    return plus((0.0, 0.0, 0.0), _direction(chance), chance.uniform(0.0, most))
