"""Measure durations of the same motions with orientd and with packages from PyPI."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from peer_timing import CASES, LIMITS, PERIOD, Orientd, Ruckig, Toppra, excess, mean_duration
from scipy.spatial.transform import RotationSpline

from orientd import rotation
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

KEYFRAMES = 8


class SciPy:
    name, what = "SciPy", "`RotationSpline`, slowed down evenly; moves at its ends"


def walks():
    """Return rotation vectors of keyframes, some 0.5 rad apart, many times."""
    random = np.random.default_rng(4)
    return [np.cumsum(random.normal(size=(KEYFRAMES, 3)) * 0.3, axis=0) for _ in range(CASES)]


def through(peer, vectors):
    """Return the seconds from rest at the first of some orientations to rest at the last."""
    if peer is Orientd:
        keys = [tuple(q) for q in rotation.exp(vectors).tolist()]
        request = MotionRequest([Keyframe(key) for key in keys])
        return plan(request, start=State.at_rest(keys[0]), limits=LIMITS, period=PERIOD).duration
    if peer is Ruckig:
        # Way points need its paid version: it comes to rest at each.
        return sum(peer.go(a, b).duration for a, b in pairwise(vectors))
    if peer is Toppra:
        return peer.through(vectors).duration
    turns = rotation.to_scipy(rotation.exp(vectors))
    steps = (turns[:-1].inv() * turns[1:]).magnitude()
    times = np.concatenate([[0.0], np.cumsum(steps)])
    spline = RotationSpline(times, turns)
    q = spline(np.arange(0.0, times[-1], PERIOD)).as_quat(scalar_first=True)
    slower = max(ratio ** (1.0 / power) for power, ratio in enumerate(excess(q), 1))
    return slower * float(times[-1])


def single(peer):
    """Return the mean duration from rest to rest between two orientations."""
    if peer is SciPy:
        return "not from rest"
    random = np.random.default_rng(3)
    aims = random.uniform(-1.2, 1.2, (CASES, 2, 3))
    return f"{np.mean([peer.go(*pair).duration for pair in aims]):.2f} s"


def on_the_way(peer):
    """Return the mean duration of motions that get a new target on the way."""
    return "not from motion" if peer is SciPy else mean_duration(peer)


def through_keyframes(peer):
    """Return the mean duration through keyframes."""
    return f"{np.mean([through(peer, vectors) for vectors in walks()]):.2f} s" + (
        ", stops at each" if peer is Ruckig else ""
    )


PEERS = (Orientd, Ruckig, Toppra, SciPy)
ROWS = (
    ("one orientation to another, from rest to rest", single),
    ("the same, with a new target after a third of the duration", on_the_way),
    (f"through {KEYFRAMES} keyframes, from rest to rest", through_keyframes),
)
