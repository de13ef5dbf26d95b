"""Curves and motions that between them call every kernel."""

from __future__ import annotations

import contextlib

import numpy as np

from orientd import kernels
from orientd.curves import METHODS
from orientd.errors import OrientdError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.recorded import states_between
from orientd.planner.state import State
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
    follow_arms()
    follow_vector()
    foretell()
    kernels.first_change(0.5, 0.01)
    follow_quintics()
    start = State.at_rest(keyframes(2)[0])
    rows = np.concatenate([keyframes(9), np.full((9, 6), 0.1)], axis=1)
    states_between(rows[:-1], rows[1:], PERIOD, np.linspace(0.1, 0.9, 8))
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


def follow_arms():
    """Solve an arm like a UR5e, also calibrated, and move its chain towards a reference."""
    links = [0.16, 0.42, 0.39, 0.13, 0.1, 0.1]
    a, d = [0.0, -0.42, -0.39, 0.0, 0.0, 0.0], [0.16, 0.0, 0.0, 0.13, 0.1, 0.1]
    twist = 0.5 * np.pi * np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0])
    table = np.array([np.zeros(6), a, d, np.cos(twist), np.sin(twist)]).T
    own = table + np.array([1e-4, 0.0, 0.0, 0.0, 0.0])
    home, tool = np.array([0.1, -1.4, 1.5, -1.6, -1.5, 0.2]), np.eye(1, 7)[0]
    for tables in ((table,), (table, own)):
        arm = np.concatenate([links, *(one.ravel() for one in tables)])
        frames, joints = np.zeros((6, 7)), np.zeros((8, 6))
        kernels.place_arm(arm, True, home, frames)
        kernels.solve_arm(arm, tool, frames[5], joints)
        kernels.follow_arm(arm, tool, np.tile(frames[5], (8, 1)), home, joints)
        kernels.reserve_arm(arm, joints, np.zeros((8, 3)))
    follow_chain(home)


def follow_chain(home):
    """Take a step of a chain towards joints and along a way, and roll out the stop after it."""
    axes = np.tile([0.0, 0.0, 1.0, 0.1, 0.2, 0.3], (6, 1))
    axes[1::2, :3] = [0.0, 1.0, 0.0]
    chain = np.concatenate([np.eye(1, 7)[0], axes.ravel()])
    limits = np.tile([-6.0, 6.0, 3.0, 40.0, np.inf], (6, 1))
    limited = chain, limits, np.full(15, 2.0), PERIOD
    moving = np.array([home, np.full(6, 0.1), np.zeros(6)])
    following = np.array([0.9, 20.0, 40.0, 0.16, 0.5, 0.5, 0.5])
    taken, goal, accelerations = np.zeros(3), np.zeros(6), np.zeros(6)
    for rows, is_way in ((4, False), (1, False), (1, True)):
        reference = np.array([home + 0.1 - 0.001 * k for k in range(rows)])
        kernels.pursue_joints(
            *limited, moving, reference, is_way, following, taken, goal, accelerations
        )
        cones = np.array([[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.1]])
        stop, strain = np.zeros((300, 6)), np.zeros(4)
        for step in (accelerations, np.full(6, np.nan)):
            kernels.roll_stop(*limited, moving, np.zeros(9), cones, 0.9, 0.01, step, stop, strain)
        kernels.brakes_outside(chain, limits, moving[:2], PERIOD, cones)


def follow_vector():
    """Take a step towards a moving target and one towards rest, and look at cones on the stop."""
    limits = np.array([2.0, 8.0, 200.0, *np.full(9, 50.0)])
    state = np.array([0.1, 0.0, 0.2, 0.3, 0.1, 0.0, 1.0, 0.0, 0.5])
    following = np.array([0.9, 20.0, 40.0, 0.5, 0.5, 0.5, 0.16, 0.2, 4.0, 0.05])
    taken, found = np.zeros(3), np.zeros(3)
    kernels.pursue_vector(limits, PERIOD, state, 0.1 * state, following, taken, found)
    kernels.halt_vector(limits, PERIOD, state, np.full(3, 0.1), found)
    kernels.stop_clearance(limits, PERIOD, state, np.array([[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.1]]))


def follow_quintics():
    """Make quintics, and sample them one by one and as the position of a path."""
    pieces, samples = np.zeros(36), np.zeros((3, 5, 3))
    kernels.put_quintics(np.array([0.5, 0.7]), np.linspace(0.0, 1.0, 27), pieces)
    kernels.quintic_at(pieces[:18], 0.2)
    breaks = np.array([0.0, 0.5, 1.2])
    kernels.sample_moves(np.linspace(-1.0, 2.0, 5), breaks, pieces.reshape(2, 18), samples)


def foretell():
    """Fit samples with and without rates, and score and read the fits."""
    fits, scores = np.zeros((77, 24)), np.zeros((77, 2))
    mean, found = np.zeros(24), np.zeros(12)
    times = -0.02 * np.arange(27.0)
    values = np.stack([0.1 * np.sin(times), 0.2 * times, 0.1 * np.cos(3.0 * times)], axis=1)
    rates = np.gradient(values, times, axis=0)
    for samples in ([times[:, None], values], [times[:, None], values, rates]):
        kernels.fit_samples(np.concatenate(samples, axis=1), 0.05, fits)
        kernels.mix_fits(fits, scores, mean)
        kernels.score_fits(fits, 0.02, values[0], 0.06, scores)
        kernels.mix_fits(fits, scores, mean)
        kernels.read_fit(mean, 0.02, found)


def planned(keys, start, **fields):
    """Return a motion from *start*."""
    request = MotionRequest(keys, approach=True, **fields)
    return plan(request, start=start, limits=LIMITS, period=PERIOD, motion_id="calls")
