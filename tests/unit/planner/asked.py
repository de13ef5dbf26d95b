"""Whole requests from ``tests/data/requests``, with the limits and the cycle of their device."""

import json
from dataclasses import replace
from pathlib import Path

from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.reading import read_request
from orientd.planner.planning import plan
from orientd.planner.state import State

FOLDER = Path(__file__).parents[2] / "data" / "requests"


def asked(name):
    """Return a request, the limits of its device, and its period."""
    found = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    limits = DEFAULT_LIMITS.with_rates(found["limits"])
    return read_request(found["motion"]), limits, found["period"]


def made(name, **changes):
    """Return the motion of a request, from rest at its first keyframe."""
    request, limits, period = asked(name)
    request = replace(request, **changes)
    start = State.at_rest(request.keys[0], request.keyframes[0].position or (0.0, 0.0, 0.0))
    return plan(request, start=start, limits=limits, period=period)
