"""Path times: ramps from and to rest, and paths with a given slowness."""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats


def quintic(u: Floats) -> Floats:
    """Return the quintic from 0 to 1 with zero velocity and acceleration at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def ramp_times(elapsed: Floats, ramp: float) -> Floats:
    """Return the path times of a path whose speed rises from 0 to 1 as a quintic over *ramp* s."""
    u = np.clip(elapsed / ramp, 0.0, 1.0)
    # The integral of quintic(u).
    passed: Floats = ramp * u**4 * (2.5 + u * (u - 3.0)) + np.maximum(0.0, elapsed - ramp)
    return passed


def run_through(slow: Floats, times: Floats) -> Floats:
    """Return the place on a path at *times*, for a given slowness.

    Its derivative is continuous, so that of the path is too.

    Args:
        slow: time per step at each sample, linear between them, positive, shape ``(n,)``.
        times: in the unit of *slow*, from 0 on.

    Returns:
        Places in samples, at most the last.
    """
    reached = np.concatenate([[0.0], np.cumsum((slow[1:] + slow[:-1]) / 2.0)])
    first = np.clip(np.searchsorted(reached, times, side="right") - 1, 0, len(slow) - 2)
    since = np.minimum(times, reached[-1]) - reached[first]
    begin, rise = slow[first], slow[first + 1] - slow[first]
    # Within a step, time is a parabola of the place; this form of its root needs no special case.
    root = np.sqrt(np.maximum(begin * begin + 2.0 * rise * since, 0.0))
    places: Floats = first + 2.0 * since / (begin + root)
    return places


def calmed(pace: Floats, width: int) -> Floats:
    """Return a smooth pace that never exceeds *pace*, shape ``(n,)``.

    Args:
        pace: of each sample, shape ``(n,)``.
        width: samples on each side over which it is averaged.
    """
    padded = np.pad(pace, 2 * width, mode="edge")
    # The average of the minimum around each sample.
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).min(axis=1)
    kernel = np.hanning(2 * width + 3)[1:-1]
    return np.convolve(least, kernel / kernel.sum(), mode="valid")
