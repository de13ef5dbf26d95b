"""The page that compares three ways to interpolate chunks, measured by the build."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orientd import rotation
from orientd.driver import ZERO
from orientd.rotation import Floats
from orientd.servo.tracking import chunks as playable
from orientd.servo.tracking.preview import Motion
from orientd.servo.tracking.tracker import Tracker, TrackPoint
from orientd.stream.records import Sample, ServoLimits

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "policy_chunks"))
from interpolated import Chunk, slerped, straight
from played import Played

PAGE = "explanation/chunks.md"

RATE, POSES, INFERENCE = 30.0, 16, 0.15
HERTZ = (0.2, 0.5, 1.0, 1.5, 2.0)
PERIOD, SETTLED, SECONDS = 0.002, 2.0, 7.0
AXIS = np.array([0.36, -0.48, 0.8])
MIDDLE = rotation.exp(np.pi * np.array([0.6, 0.0, 0.8]))
LIMITS = ServoLimits(3.75, 25.0, 8500.0, 1.0, 1.0, 1.0)
FAR = 1.0
"""Error beyond which no lag says anything, rad."""

LARGEST, LARGEST_ACCELERATION = 1.0, 12.0

_HEAD = f"""\
# Interpolation of chunks

A simulated policy follows a sine about a fixed axis. It sends chunks of {POSES} poses at
{RATE:g} Hz, each {1e3 * INFERENCE:.0f} ms after its observation. Three methods interpolate the
same chunks to {1 / PERIOD:g} setpoints a second. The table compares these setpoints with the sine.

- **orientd** is [`robot.play()`](../tutorials/policy.md), with limits of {LIMITS.velocity:g} rad/s,
  {LIMITS.acceleration:g} rad/s² and {LIMITS.jerk:g} rad/s³.
- **slerp** is piecewise spherical linear interpolation. A new chunk starts from the last setpoint.
- **components** is linear interpolation of the components of the rotation vectors.

The sine has an amplitude of at most {LARGEST:g} rad and a peak acceleration of at most
{LARGEST_ACCELERATION:g} rad/s². At the middle of the swing the rotation vector is half a turn long
and changes its sign, so linear interpolation of its components passes through distant orientations.

- *Error* is the largest angle between a setpoint and the sine.
- *Lag* is the delay that fits all setpoints best.
- *Peak* is the largest acceleration of the setpoints, relative to that of the sine.

"""

_TABLE = """\
| Sine | orientd: error, mrad | lag, ms | peak | slerp: error, mrad | lag, ms | peak \
| components: error, mrad | lag, ms | peak |
|---|---|---|---|---|---|---|---|---|---|
"""


class Figures(NamedTuple):
    """How well setpoints follow a sine.

    Attributes:
        error: largest angle to it, rad.
        lag: s.
        peak: largest acceleration over that of the sine.
    """

    error: float
    lag: float
    peak: float


class Sine:
    """A swing about a fixed axis.

    Attributes:
        hertz: its frequency.
        amplitude: rad.
    """

    def __init__(self, hertz: float) -> None:
        """Swing as far as the page says."""
        self.hertz, self._spin = hertz, 2.0 * np.pi * hertz
        self.amplitude = min(LARGEST, LARGEST_ACCELERATION / self._spin**2)

    def at(self, times: Floats) -> Floats:
        """Return orientations, shape ``(n, 4)``."""
        angles = self.amplitude * np.sin(self._spin * times)
        return rotation.multiply(MIDDLE, rotation.exp(angles[:, None] * AXIS))

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of the policy."""
        for observed in np.arange(0.0, SECONDS, INFERENCE):
            times = observed + np.arange(POSES) / RATE
            yield Chunk(observed + INFERENCE, times, rotation.log(self.at(times)))

    def figures(self, played: Played) -> Figures:
        """Compare setpoints with the sine, after the beginning."""
        times = played.begin + played.period * np.arange(len(played.q))
        settled = times > SETTLED
        times, q = times[settled], played.q[settled]
        gaps = rotation.log(rotation.between(q, self.at(times)))
        speeds = self.amplitude * self._spin * np.cos(self._spin * times)
        lag = float(speeds @ (gaps @ AXIS) / (speeds @ speeds))
        peak = Played(played.name, times[0], played.period, q)
        most = self.amplitude * self._spin**2
        return Figures(
            float(np.linalg.norm(gaps, axis=1).max()), lag, float(peak.acceleration.max()) / most
        )


def followed(sine: Sine) -> Played:
    """Return the setpoints of orientd: its tracker in virtual time."""
    tracker, coming = Tracker(PERIOD), list(sine.chunks())
    point = TrackPoint(tuple(sine.at(np.zeros(1))[0].tolist()), ZERO, ZERO)
    tracker.begin(*point, LIMITS)
    period_ns, sent = round(1e9 * PERIOD), []
    for k in range(1, round(SECONDS / PERIOD)):
        now_ns = k * period_ns
        while coming and coming[0].arrives <= 1e-9 * now_ns:
            chunk = coming.pop(0)
            stamps = [round(1e9 * when) for when in chunk.times]
            poses = map(tuple, rotation.exp(chunk.vectors).tolist())
            samples = [Sample(when, q) for when, q in zip(stamps, poses, strict=True)]
            curve = playable.Chunk(playable.smoothed(samples, LIMITS).knots, has_positions=False)
            motion = Motion(*point, ZERO, ZERO, ZERO)
            tracker.take_chunk(curve, motion, now_ns - period_ns)
        point = tracker.step(now_ns)
        sent.append(point.q)
    return Played("orientd", PERIOD, PERIOD, np.array(sent))


def measured(hertz: float) -> tuple[Figures, Figures, Figures]:
    """Return the figures of orientd, piecewise slerp, and straight lines between components."""
    sine = Sine(hertz)
    others = (play(sine.chunks(), PERIOD, SECONDS) for play in (slerped, straight))
    mine, slerp, components = map(sine.figures, (followed(sine), *others))
    return mine, slerp, components


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the page."""
    del source
    rows = []
    for hertz in HERTZ:
        cells = [f"{hertz:g} Hz, {Sine(hertz).amplitude:.2g} rad"]
        for one in measured(hertz):
            lag = _number(1e3 * abs(one.lag)) if one.error < FAR else "none fits"
            cells += [_number(1e3 * one.error), lag, _number(one.peak)]
        rows.append(f"| {' | '.join(cells)} |\n")
    yield PAGE, _HEAD + _TABLE + "".join(rows)


def _number(value: float) -> str:
    return f"{value:,.2f}" if value < 100.0 else f"{value:,.0f}"
