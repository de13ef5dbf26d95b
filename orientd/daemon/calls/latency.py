"""How far the arm is behind its setpoints, from what was sent and what was measured.

Not for the servo process: it looks at a whole motion at once.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from orientd.driver import Quaternion, Vector3
from orientd.floats import conjugate, log, multiply

_LEAST_TURN = 0.01


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
    sent: Sequence[tuple[float, Quaternion]],
    measured: Sequence[tuple[float, Quaternion]],
    *,
    longest: float = 0.4,
    step: float = 0.002,
) -> Latency:
    """Return the delay at which *measured* correlates best with *sent*.

    The mean square of the difference is smallest where the cross-correlation of the two is
    largest; a parabola through the three least values finds the delay between two steps.

    Args:
        sent: time (s) and orientation of each setpoint, in order.
        measured: the same of the measurements, on the same clock.
        longest: largest delay looked for, s.
        step: distance of the delays tried, s.

    Raises:
        ValueError: there are too few measurements, or the motion turned by too little to tell.
    """
    if len(sent) < 3 or len(measured) < 3:
        raise ValueError(f"3 of each are needed, got {len(sent)} and {len(measured)}")
    origin = conjugate(sent[0][1])
    times = [time for time, _ in sent]
    path = [log(multiply(origin, q)) for _, q in sent]
    turned = max(sqrt(x * x + y * y + z * z) for x, y, z in path)
    if turned < _LEAST_TURN:
        raise ValueError(f"the motion must turn by {_LEAST_TURN} rad or more, got {turned:.3g}")
    points = [(t, log(multiply(origin, q))) for t, q in measured if times[0] <= t <= times[-1]]
    if len(points) < 3:
        raise ValueError("the measurements are not of the time of the setpoints")
    count = round(longest / step)
    squares = [_mean_square(times, path, points, k * step) for k in range(count + 1)]
    best = min(range(count + 1), key=squares.__getitem__)
    seconds = best * step
    if 0 < best < count:
        before, here, after = squares[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        seconds += 0.5 * step * (before - after) / bend if bend > 0.0 else 0.0
    led = _mean_square(times, path, points, seconds)
    return Latency(seconds, sqrt(squares[0]), sqrt(led))


def _mean_square(
    times: Sequence[float],
    path: Sequence[Vector3],
    points: Sequence[tuple[float, Vector3]],
    delay: float,
) -> float:
    total = 0.0
    for time, (x, y, z) in points:
        at = time - delay
        k = bisect_left(times, at)
        if k == 0:
            a, b, c = path[0]
        elif k == len(times):
            a, b, c = path[-1]
        else:
            share = (at - times[k - 1]) / (times[k] - times[k - 1])
            p, q = path[k - 1], path[k]
            a = p[0] + share * (q[0] - p[0])
            b = p[1] + share * (q[1] - p[1])
            c = p[2] + share * (q[2] - p[2])
        total += (x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2
    return total / len(points)
