"""Curves and motions that between them call every kernel."""

from __future__ import annotations

import contextlib

import numpy as np

from orientd.curves import METHODS
from orientd.errors import OrientdError
from orientd.planner import Keyframe, Limits, MotionRequest, State, plan, states_between
from orientd.planner.certify.brake import brake_rate
from orientd.planner.connect import try_joins
from orientd.rotation import exp, multiply

LIMITS = Limits(2.0, 8.0, 200.0, 1.0, 10.0)
PERIOD = 0.002
SHORTEST = {"slerp", "kks_hermite", "kks_quintic_hermite"}


def keyframes(count):
    """Return quaternions some 0.5 rad apart."""
    found = [np.array([1.0, 0.0, 0.0, 0.0])]
    for k in range(count - 1):
        found.append(multiply(found[-1], exp(0.5 * np.array([np.cos(k), np.sin(2.0 * k), 0.4]))))
    return np.array(found)


def make_calls():
    """Make a curve of each family, and motions from rest, from motion, timed and in pieces."""
    for name, family in METHODS.items():
        count = 2 if name in SHORTEST else 5
        curve = family(keys=keyframes(count), times=np.arange(float(count)))
        curve.evaluate(np.linspace(*curve.domain, 50))
    start = State.at_rest(keyframes(2)[0])
    rows = np.concatenate([keyframes(9), np.full((9, 6), 0.1)], axis=1)
    states_between(rows[:-1], rows[1:], PERIOD, np.linspace(0.1, 0.9, 8))
    brake_rate(rows[:, 4:7], rows[:, 7:10], np.full(9, 2.0), 8.0, 200.0)
    ends = [(rows[k : k + 4, :4], rows[:4, 4:7], rows[:4, 7:10]) for k in (0, 1)]
    try_joins(*ends, np.linspace(0.5, 2.0, 4), start, LIMITS)
    many = [Keyframe(tuple(q.tolist())) for q in keyframes(6)]
    timed = [Keyframe(one.q, 2.0 * k) for k, one in enumerate(many)]
    moving_ends = {"start_velocity": (0.3, 0.0, 0.1), "end_velocity": (0.0, 0.2, 0.0)}
    moving = planned(many, start).state_at(200)
    planned(many[-2:-1], moving)
    planned(many[::-1], moving)
    planned(many[1:], start, **moving_ends)
    planned(timed[1:], start, **moving_ends)
    planned(many, start, pace="even")
    planned(many, start, method="squad")
    planned(many, start, method="piecewise_slerp")
    for method in ("squad", "kks_hermite_spline", "minimum_effort"):
        with contextlib.suppress(OrientdError):
            planned(many[:4], start, method=method, pace="even")


def planned(keys, start, **fields):
    """Return a motion from *start*."""
    request = MotionRequest(keys, approach=True, **fields)
    return plan(request, start=start, limits=LIMITS, period=PERIOD, motion_id="calls")
