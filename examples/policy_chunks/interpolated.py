"""Two common ways to interpolate the chunks of a policy: by components, and by slerp."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from played import Played

from orientd import rotation
from orientd.rotation import Floats


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


def straight(given: Iterable[Chunk], period: float, seconds: float) -> Played:
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
    return Played("straight lines", begin, period, rotation.exp(rows))


def slerped(given: Iterable[Chunk], period: float, seconds: float) -> Played:
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
    return Played("piecewise slerp", begin, period, np.array(sent))
