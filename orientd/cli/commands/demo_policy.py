"""`orientd demo policy`: the chunks of a policy, joined in two common ways and by orientd."""

from __future__ import annotations

import random
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orientd import plots, rotation
from orientd.rotation import Floats, Quaternion

if TYPE_CHECKING:
    from orientd.cli.output import Output
    from orientd.client import PlayTiming, Robot
    from orientd.stream import Cycle

SECONDS, RATE, POSES = 4.0, 30.0, 16
INFERENCE = 0.15
"""Inference time of the policy for a chunk, s."""

LOSS = 0.05
"""Share of lost poses."""

NOISE = 2e-3
"""Disagreement of two chunks, rad."""

# Two rotation vectors of a real policy: neighbours in time, 47 degrees apart, but components of
# opposite sign, since a turn by more than half a turn is the other way round.
FROM = (1.4108558893203735, -0.14490126073360443, 2.2968666553497314)
TO = (-1.9869475665660719, -0.20934335242279448, -2.127417674763405)


@dataclass(frozen=True, slots=True)
class Chunk:
    """One answer of the policy.

    Attributes:
        arrives: when, s.
        times: of its poses, s; the first of them have passed by then.
        vectors: rotation vectors, rad, each at most half a turn long.
    """

    arrives: float
    times: Floats
    vectors: Floats


def chunks(seed: int = 1) -> Iterator[Chunk]:
    """Yield the chunks of a policy that swings to and fro between two orientations."""
    rng, start = random.Random(seed), rotation.exp(FROM)
    way = rotation.log(rotation.between(start, rotation.exp(TO)))
    for observed in np.arange(0.0, SECONDS, INFERENCE):
        kept = [k for k in range(POSES) if rng.random() > LOSS]
        times = observed + np.array(kept) / RATE
        shares = 0.5 - 0.5 * np.cos(np.pi * times)
        noise = rotation.exp([rng.gauss(0.0, NOISE) for _ in range(3)])
        q = rotation.multiply(rotation.multiply(start, rotation.exp(shares[:, None] * way)), noise)
        yield Chunk(observed + INFERENCE, times, rotation.log(q))


def straight(given: Iterable[Chunk], period: float, seconds: float = SECONDS) -> plots.Played:
    """Return the setpoints that interpolate each component of the rotation vectors.

    Args:
        given: the chunks, in the order of their arrival.
        period: of the setpoints, s.
        seconds: when the last setpoint is.
    """
    rows: list[list[float]] = []
    present: Chunk | None = None
    coming = list(given)
    begin = coming[0].arrives
    for now in np.arange(begin, seconds, period):
        while coming and coming[0].arrives <= now:
            present = coming.pop(0)
        if present is not None:
            rows.append([np.interp(now, present.times, column) for column in present.vectors.T])
    return plots.Played("straight lines", begin, period, rotation.exp(rows))


def slerped(given: Iterable[Chunk], period: float, seconds: float = SECONDS) -> plots.Played:
    """Return the setpoints of a spherical linear interpolation between the poses.

    A chunk replaces all poses before it: the first piece leads from the present setpoint to its
    next pose.  So does ``PoseTrajectoryInterpolator`` of diffusion_policy and UMI
    (https://github.com/real-stanford/diffusion_policy, ``common``), here without its speed limits.

    Args:
        given: the chunks, in the order of their arrival.
        period: of the setpoints, s.
        seconds: when the last setpoint is.
    """
    coming = list(given)
    begin = coming[0].arrives
    q = rotation.exp(coming[0].vectors[0])
    knots, poses = np.zeros(1), q[None]
    sent: list[Floats] = []
    for now in np.arange(begin, seconds, period):
        while coming and coming[0].arrives <= now:
            chunk = coming.pop(0)
            live = chunk.times > now
            knots = np.array([now, *chunk.times[live]])
            poses = np.array([q, *rotation.exp(chunk.vectors[live])])
        piece = min(int(np.searchsorted(knots, now, side="right")), len(knots) - 1)
        span = knots[piece] - knots[piece - 1]
        share = min((now - knots[piece - 1]) / span, 1.0)
        turn = rotation.log(rotation.between(poses[piece - 1], poses[piece]))
        q = rotation.multiply(poses[piece - 1], rotation.exp(share * turn))
        sent.append(q)
    return plots.Played("piecewise slerp", begin, period, np.array(sent))


def played(robot: Robot, cycles: list[Cycle], period: float) -> tuple[plots.Played, PlayTiming]:
    """Play the chunks on the device; return the setpoints that it got, and how it went.

    Args:
        robot: the connection.
        cycles: of the device, as they happen.
        period: of the device, s.
    """
    from orientd.stream import ServoState

    robot.move([{"rotation_vector": FROM}], approach=True).wait()
    with robot.play() as play:
        begin = time.monotonic()
        for chunk in chunks():
            time.sleep(max(begin + chunk.arrives - time.monotonic(), 0.0))
            poses = Quaternion.from_array(rotation.exp(chunk.vectors), order="wxyz")
            play.chunk(poses if isinstance(poses, list) else [poses], times=chunk.times + begin)
    sent = [cycle.q for cycle in cycles if cycle.state is ServoState.TRACKING]
    return plots.Played("orientd", 0.0, period, np.array(sent)), play.timing()


def show(robot: Robot, cycles: list[Cycle], out: Output, path: Path | None) -> None:
    """Play the chunks in three ways, print the figures, and draw them to *path* if it is given."""
    (device,) = robot.devices()
    period = 1.0 / device.rate_hz
    out.say(
        f"policy: chunks of {POSES} poses at {RATE:g} Hz, {INFERENCE:g} s for each, "
        f"{LOSS:.0%} of the poses lost, rotation vectors that change their sign"
    )
    smooth, timing = played(robot, cycles, period)
    players = (straight(chunks(), period), slerped(chunks(), period), smooth)
    limit = device.limits.acceleration
    figures = {
        player.name.replace(" ", "_"): {
            "turned": float(player.turned[-1]),
            "largest_step": float(player.steps.max()),
            "acceleration": float(player.acceleration.max()),
            "cycles_above_limit": int(np.sum(player.acceleration > 1.001 * limit)),
        }
        for player in players
    }
    rows = [
        f"  {name.replace('_', ' '):<20}{np.degrees(one['turned']):>13.0f}"
        f"{np.degrees(one['largest_step']):>16.2f}{one['acceleration']:>23.3g}"
        f"{one['cycles_above_limit']:>20}"
        for name, one in figures.items()
    ]
    out.say(
        "",
        f"  {'':<20}{'turned, deg':>13}{'per cycle, deg':>16}{'acceleration, rad/s^2':>23}"
        f"{'cycles above limit':>20}",
        *rows,
        f"  {'limit':<20}{'':>29}{limit:>23.3g}",
        f"  {'late poses':<20} {timing.stale} in {timing.chunks} chunks, past on arrival",
    )
    if path is not None:
        arrivals = [chunk.arrives for chunk in chunks()]
        plots.draw_played(path, players, limit, arrivals, title="The chunks of a policy, as sent")
    out.answer(
        {**figures, "limit": limit, "timing": timing, "picture": path and path.absolute()},
        f"  {'picture':<20} {path.absolute() if path else 'none'}",
    )
