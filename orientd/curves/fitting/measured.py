"""Orientations as they were measured, made fit for use: in order, of one sign, none wild."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orientd.errors import PlanError
from orientd.rotation import Floats, align, conjugate, log, multiply

FEWEST = 8
"""Samples that a fit needs."""

_NORMS = (0.5, 2.0)
_WILD = 6.0
"""Standard deviations of the noise, beyond which a sample is wild."""

_LEAST_WILD = 2e-3
"""rad; nearer than this to its neighbours no sample is wild, however little noise there is."""

_PASSES = 20
_GAUSSIAN = 1.4826  # standard deviations in a median of absolute deviations


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Samples of an orientation.

    Attributes:
        times: increasing, s, shape ``(n,)``.
        q: unit quaternions, the signs of neighbours alike, shape ``(n, 4)``.
        noise: standard deviation of the noise about each axis, rad.
        left_out: samples that were missing, repeated or wild.
    """

    times: Floats
    q: Floats
    noise: float
    left_out: int


def clean(times: ArrayLike, q: ArrayLike) -> Measured:
    """Return samples in order, without those that are missing, repeated or wild.

    A sample is held against the cubic through two neighbours on either side; a wild one is further
    from it than the noise of all explains.

    Args:
        times: s, shape ``(n,)``, in any order.
        q: orientations ``(w, x, y, z)`` of either sign, shape ``(n, 4)``.

    Raises:
        ValueError: the shapes are not as said.
        PlanError: fewer than :data:`FEWEST` samples are left.
    """
    instants, found = np.asarray(times, dtype=np.float64), np.asarray(q, dtype=np.float64)
    if instants.ndim != 1 or found.shape != (len(instants), 4):
        raise ValueError(
            f"times and q must have shapes (n,) and (n, 4), got {instants.shape} and {found.shape}"
        )
    given = len(instants)
    with np.errstate(over="ignore"):  # what is out of all range is left out
        norms = np.sqrt(np.sum(found * found, axis=-1))
    is_there = np.isfinite(instants) & (norms > _NORMS[0]) & (norms < _NORMS[1])
    instants, found = instants[is_there], found[is_there] / norms[is_there, None]
    instants, order = np.unique(instants, return_index=True)
    found = found[order]
    noise = 0.0
    for _ in range(_PASSES):
        if len(instants) < FEWEST:
            raise PlanError(f"a fit needs at least {FEWEST} samples, got {len(instants)}")
        misses, spread = _misses(instants, found)
        noise = _GAUSSIAN * float(np.median(np.abs(misses / spread[:, None])))
        size = np.sqrt(np.sum(misses**2, axis=-1))
        excess = size / np.maximum(_WILD * noise * spread, _LEAST_WILD)
        # The neighbours of a wild sample miss their cubics too, but by less.
        around = np.lib.stride_tricks.sliding_window_view(np.pad(excess, 2), 5).max(axis=1)
        is_wild = (excess > 1.0) & (excess >= around)
        if not is_wild.any():
            break
        keep = np.ones(len(instants), dtype=bool)
        keep[2:-2] = ~is_wild
        # The two outermost have no cubic of their own: whether it is they that are wild or the next
        # one cannot be said, and if they stayed the next ones would go one after the other.
        keep[:2] &= not is_wild[0]
        keep[-2:] &= not is_wild[-1]
        instants, found = instants[keep], found[keep]
    return Measured(instants, align(found), noise, given - len(instants))


def _misses(times: Floats, q: Floats) -> tuple[Floats, Floats]:
    """Return by how much samples miss the cubic through their neighbours, two on either side.

    Returns:
        Turns in rad, shape ``(n - 4, 3)``, and how much noise is amplified in each, ``(n - 4,)``.
    """
    count = len(times) - 4
    here = slice(2, 2 + count)
    places = (0, 1, 3, 4)
    nodes = np.stack([times[k : k + count] for k in places]) - times[here]
    miss: Floats = np.zeros((count, 3))
    squares = np.ones(count)
    for k, place in enumerate(places):
        others = [j for j in range(4) if j != k]
        weight = np.prod([nodes[j] / (nodes[j] - nodes[k]) for j in others], axis=0)
        turn = log(multiply(conjugate(q[here]), q[place : place + count]))
        miss += weight[:, None] * turn
        squares += weight**2
    return miss, np.sqrt(squares)
