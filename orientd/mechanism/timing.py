"""How far along a path to be when: ramps from and to rest, and a given slowness."""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats


def quintic(u: Floats) -> Floats:
    """Return the quintic from 0 to 1 that is at rest, with no acceleration, at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def ramp_times(elapsed: Floats, ramp: float) -> Floats:
    """Return the path times of a path whose speed rises from 0 to 1 as a quintic over *ramp* s."""
    u = np.clip(elapsed / ramp, 0.0, 1.0)
    # The integral of quintic(u).
    passed: Floats = ramp * u**4 * (2.5 + u * (u - 3.0)) + np.maximum(0.0, elapsed - ramp)
    return passed


def run_through(slow: Floats, times: Floats) -> Floats:
    """Return how far along a path one is at *times* that is run through with a slowness.

    Its derivative is continuous, so the path's own is too.

    Args:
        slow: time that a step of the path takes about each of its samples, linear between them,
            positive, shape ``(n,)``.
        times: in the unit of *slow*, from 0 on.

    Returns:
        Places in samples, at most the last.
    """
    reached = np.concatenate([[0.0], np.cumsum((slow[1:] + slow[:-1]) / 2.0)])
    first = np.clip(np.searchsorted(reached, times, side="right") - 1, 0, len(slow) - 2)
    since = np.minimum(times, reached[-1]) - reached[first]
    begin, rise = slow[first], slow[first + 1] - slow[first]
    # The time is a parabola of the place in each step: its root, in the form that needs no case.
    root = np.sqrt(np.maximum(begin * begin + 2.0 * rise * since, 0.0))
    places: Floats = first + 2.0 * since / (begin + root)
    return places


def calmed(pace: Floats, width: int) -> Floats:
    """Return a smooth pace that is nowhere above *pace*, shape ``(n,)``.

    Args:
        pace: of each sample, shape ``(n,)``.
        width: samples to each side over which it is averaged.
    """
    padded = np.pad(pace, 2 * width, mode="edge")
    # The least around each sample, averaged.
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).min(axis=1)
    kernel = np.hanning(2 * width + 3)[1:-1]
    return np.convolve(least, kernel / kernel.sum(), mode="valid")
