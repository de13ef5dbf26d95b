"""Notes on a planned motion that its request does not lead one to expect.

They say that it turns further than the short way, or that stops make it slow.  They also say which
limit makes the position slow, or the rotation.
"""

from __future__ import annotations

import math

import numpy as np

from orientd.curves.contract import METHODS
from orientd.curves.roles import is_pair
from orientd.model.limits import UNITS
from orientd.planner.certify.brake import LONGEST_STOP
from orientd.planner.certify.certificate import Peak
from orientd.planner.motion import Motion
from orientd.planner.path import Path
from orientd.planner.timing.knots import turn_lengths
from orientd.rotation import Floats, angle

SLOW = (
    f"slower than its limits allow, so that a stop on the path takes {LONGEST_STOP:g} s: with such "
    "an acceleration it takes that long from a higher velocity"
)

SWING, _FAR = 0.5 * math.pi, math.pi
"""How much further than the short way a part may turn, rad: if it can be helped, and without a
note."""

_MUCH = 0.9  # of a limit, and of the longest stop
_LITTLE = 0.5  # of a limit
_STILL = 1e-6  # of a limit: rounding


def remarked(motion: Motion) -> Motion:
    """Return the motion with the notes of this module in its certificate."""
    return motion.noted(*_on_turns(motion), *_on_limits(motion), *_on_stops(motion))


def excess(motion: Motion) -> Floats:
    """Return how much further than the short way each part of a motion turns, rad.

    The parts are the lead-in, the intervals between keyframes, and the lead-out.  Requested whole
    turns belong to the short way.

    Returns:
        Shape ``(n + 1,)`` for *n* keyframes; zero if all of it is little, or if the request chooses
        the way itself.
    """
    request, path = motion.request, motion.path
    short: Floats = np.zeros(len(request.keyframes) + 1)
    is_chosen = is_pair(METHODS[request.method]) and bool(request.options)
    if is_chosen or not isinstance(path, Path):
        return short
    short[0] = float(angle(path.first, request.keys[0]))
    short[1:-1] = turn_lengths(request)
    if motion.certificate.peak_velocity.value * motion.duration <= short.sum() + SWING:
        return np.zeros(len(short))
    ends = np.concatenate([[0.0], motion.keyframe_times, [motion.duration]])
    found: Floats = np.diff(path.trajectory.turned(ends)) - short
    return found


def _on_turns(motion: Motion) -> list[str]:
    further = excess(motion)
    parts = np.flatnonzero(further > _FAR)
    if not len(parts):
        return []
    part = int(parts[np.argmax(further[parts])])
    if part in (0, len(further) - 1):
        place = "in the lead-in" if part == 0 else "in the lead-out"
    else:
        place = f"between {motion.request.named(part - 1)} and {motion.request.named(part)}"
    far = float(further[part])
    others = f", and far more in {len(parts) - 1} other parts" if len(parts) > 1 else ""
    return [
        f"turns {far:.4g} rad ({far / (2.0 * math.pi):.2g} turns) more than the short way "
        f"{place}{others}"
    ]


def _on_limits(motion: Motion) -> list[str]:
    """Return a note if the rotation halves the speed of the position, or the other way round."""
    request, found = motion.request, motion.certificate
    turns = {
        "angular velocity": found.peak_velocity,
        "angular acceleration": found.peak_acceleration,
        "angular jerk": found.peak_jerk,
    }
    moves = {
        "velocity of the position": found.peak_linear_velocity,
        "acceleration of the position": found.peak_linear_acceleration,
    }
    is_free = request.is_quickest and request.total is None
    if not is_free:
        return []
    for ruling, others, slowed in (
        (turns, moves, "the position moves"),
        (moves, turns, "the device turns"),
    ):
        most = next(iter(others.values()))
        name, peak = max(ruling.items(), key=lambda entry: entry[1].ratio)
        is_slowed = max(map(_ratio, others.values())) < _MUCH and _STILL < most.ratio < _LITTLE
        if peak.ratio > _MUCH and is_slowed and math.isfinite(most.limit):
            unit = UNITS["velocity" if others is turns else "linear_velocity"]
            return [
                f"the limit of the {name} sets the speed: {slowed} at {most.value:.3g} {unit} at "
                f"most, its limit is {most.limit:.3g} {unit}"
            ]
    return []


def _ratio(peak: Peak) -> float:
    return peak.ratio


def _on_stops(motion: Motion) -> list[str]:
    """Return a note if a motion is slower than its limits for the sake of stops.

    This concerns devices whose stops take long even with the full acceleration.
    """
    found = motion.certificate
    is_slower = max(found.peak_velocity.ratio, found.peak_acceleration.ratio) < _MUCH
    is_held_back = found.stop_time > _MUCH * LONGEST_STOP and is_slower
    return [SLOW] if motion.request.is_quickest and is_held_back else []
