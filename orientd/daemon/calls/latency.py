"""How far the arm is behind its setpoints, from what was sent and what was measured.

Not for the servo process: it looks at a whole motion at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from orientd import rotation
from orientd.driver import Quaternion
from orientd.rotation import Floats

_LEAST_TURN = 0.01
_LONGEST, _STEP = 0.4, 0.002
"""Largest delay looked for, and distance of the delays tried, s."""


@dataclass(frozen=True, slots=True)
class Latency:
    """The delay that explains the measurements best.

    Attributes:
        seconds: the delay.
        error: root mean square of what was measured against what was sent, rad.
        error_led: the same, against what was sent that much earlier, rad.
    """

    seconds: float
    error: float
    error_led: float


def identify(
    sent: Sequence[tuple[float, Quaternion]], measured: Sequence[tuple[float, Quaternion]]
) -> Latency:
    """Return the delay at which *measured* correlates best with *sent*.

    The mean square of the difference is smallest where the cross-correlation of the two is
    largest; a parabola through the three least values finds the delay between two steps.

    Args:
        sent: time (s) and orientation of each setpoint, in order.
        measured: the same of the measurements, on the same clock.

    Raises:
        ValueError: there are too few measurements, or the motion turned by too little to tell.
    """
    if len(sent) < 3 or len(measured) < 3:
        raise ValueError(f"3 of each are needed, got {len(sent)} and {len(measured)}")
    origin = rotation.conjugate(sent[0][1])
    times, path = _turned(origin, sent)
    turned = float(np.linalg.norm(path, axis=1).max())
    if turned < _LEAST_TURN:
        raise ValueError(f"the motion must turn by {_LEAST_TURN} rad or more, got {turned:.3g}")
    instants, points = _turned(origin, [one for one in measured if times[0] <= one[0] <= times[-1]])
    if len(points) < 3:
        raise ValueError("the measurements are not of the time of the setpoints")

    def mean_square(delay: float) -> float:
        expected = [np.interp(instants - delay, times, component) for component in path.T]
        return float(((points.T - expected) ** 2).sum(axis=0).mean())

    count = round(_LONGEST / _STEP)
    squares = [mean_square(k * _STEP) for k in range(count + 1)]
    best = min(range(count + 1), key=squares.__getitem__)
    seconds = best * _STEP
    if 0 < best < count:
        before, here, after = squares[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        seconds += 0.5 * _STEP * (before - after) / bend if bend > 0.0 else 0.0
    led = mean_square(seconds)
    return Latency(seconds, sqrt(squares[0]), sqrt(led))


def _turned(
    origin: Floats, orientations: Sequence[tuple[float, Quaternion]]
) -> tuple[Floats, Floats]:
    """Return times, and the rotation vectors ``(n, 3)`` from the conjugate of *origin* to then."""
    times = np.array([time for time, _ in orientations])
    q = np.array([q for _, q in orientations]).reshape(-1, 4)
    return times, rotation.log(rotation.multiply(origin, q))
