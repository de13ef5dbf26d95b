"""Least durations of ten curves under limits of velocity, acceleration and jerk, on a fine grid.

    python tests/data/quickest/regenerate.py

The curve is orientd's, that of an even pace; everything else is not.  For the squared rate at the
nodes of a grid, with differences of the nodes for its derivatives, a sequence of linear programs
(HiGHS by SciPy) inside a shrinking box lowers the sum of ``step / sqrt(y)`` under limits of the
components of omega, alpha and jerk, all three linearised, until nothing moves.  The durations at
two grids give the third by Richardson's rule, which is what is stored.
"""

import json
from pathlib import Path

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, diags, vstack
from scipy.spatial.transform import Rotation

from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

ROUNDS = 60


def keyframes(seed, count, step):
    random = np.random.default_rng(seed)
    rotation = Rotation.identity()
    found = [rotation]
    for turn in random.normal(size=(count - 1, 3)):
        rotation = rotation * Rotation.from_rotvec(step * turn / np.linalg.norm(turn))
        found.append(rotation)
    quaternions = np.array([r.as_quat()[[3, 0, 1, 2]] for r in found])
    signs = np.sign(np.sum(quaternions[1:] * quaternions[:-1], axis=1))
    quaternions[1:] *= np.cumprod(signs)[:, None]
    return quaternions


def evenly_paced(q):
    """Return the part of an even motion between its keyframes, from rest to rest."""
    request = MotionRequest([Keyframe(tuple(key)) for key in q], pace="even")
    start = State.at_rest(request.keys[0])
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002).path.trajectory


def least_duration(segment, limits, nodes):
    """Return the duration of the quickest way along part of a path, from rest to rest."""
    s = np.linspace(0.0, 1.0, nodes)
    h = s[1] - s[0]
    # Jerk between the nodes, everything else at them.
    middle = 0.5 * (s[1:] + s[:-1])
    end = segment.duration
    _, w, a = segment.sample(end * s)
    _, wm, am = segment.sample(end * middle)
    w, wm, a, am = w * end, wm * end, a * end**2, am * end**2
    jm = np.diff(a, axis=0) / h
    velocity, acceleration, jerk = (
        np.array(limits[k]) for k in ("velocity", "acceleration", "jerk")
    )

    # Two more nodes outside, so that differences reach the ends.
    size = nodes + 2
    at = diags([1.0], [1], shape=(nodes, size), format="csr")
    slope = diags([-0.5 / h, 0.5 / h], [0, 2], shape=(nodes, size), format="csr")
    bend = diags([1 / h**2, -2 / h**2, 1 / h**2], [0, 1, 2], shape=(nodes, size), format="csr")
    mean = diags([0.5, 0.5], [0, 1], shape=(nodes - 1, nodes), format="csr")
    at_m, slope_m, bend_m = (
        diags([0.5, 0.5], [1, 2], shape=(nodes - 1, size), format="csr"),
        diags([-1 / h, 1 / h], [1, 2], shape=(nodes - 1, size), format="csr"),
        mean @ bend,
    )
    rows, sides = [], []
    for axis in range(3):
        rows.append(diags(w[:, axis] ** 2) @ at)
        sides.append(np.full(nodes, velocity[axis] ** 2))
        push = diags(a[:, axis]) @ at + 0.5 * diags(w[:, axis]) @ slope
        rows += [push, -push]
        sides += [np.full(nodes, acceleration[axis])] * 2
    fixed, fixed_sides = vstack(rows), np.concatenate(sides)
    pulls = [
        diags(jm[:, k]) @ at_m + 1.5 * diags(am[:, k]) @ slope_m + 0.5 * diags(wm[:, k]) @ bend_m
        for k in range(3)
    ]

    scale = min(
        float(np.min(velocity / np.abs(w).max(axis=0))) ** 2,
        float(np.min(acceleration / np.abs(a).max(axis=0))),
        float(np.min(jerk / np.abs(jm).max(axis=0))) ** (2 / 3),
    )
    y = np.full(size, 0.9 * scale)
    weights = np.full(nodes, h)
    weights[[0, -1]] *= 0.5
    box, before = 0.5, np.inf
    for _ in range(ROUNDS):
        ym = at_m @ y
        rows, sides = [fixed], [fixed_sides]
        for axis, pull in enumerate(pulls):
            # J y^-1/2 by its tangent, which lies below it.
            tangent = diags(0.5 * jerk[axis] * ym**-1.5) @ at_m
            for sign in (1.0, -1.0):
                rows.append(sign * pull + tangent)
                sides.append(1.5 * jerk[axis] * ym**-0.5)
        cost = -0.5 * at.T @ (weights * (at @ y) ** -1.5)
        found = linprog(
            cost,
            A_ub=csr_matrix(vstack(rows)),
            b_ub=np.concatenate(sides),
            bounds=np.stack([y * (1 - box), y * (1 + box)], axis=1),
            method="highs",
        )
        if found.x is None:
            raise RuntimeError(found.message)
        new = found.x
        duration = float(np.sum(weights / np.sqrt(at @ new)))
        if duration < before:
            y = new
            if before - duration < 1e-6 * duration:
                return duration
            before = duration
        else:
            box *= 0.5
            if box < 1e-4:
                break
    return before


LIMITS = [
    {"velocity": [1.0, 1.0, 1.0], "acceleration": [3.0, 3.0, 3.0], "jerk": [40.0, 40.0, 40.0]},
    {"velocity": [2.0, 1.0, 1.5], "acceleration": [4.0, 8.0, 5.0], "jerk": [60.0, 60.0, 200.0]},
]
SHAPES = [(3, 1.0), (4, 0.5), (5, 1.2), (6, 0.8), (8, 0.6)]


def main():
    cases = []
    for k, (count, step) in enumerate(SHAPES):
        for which, limits in enumerate(LIMITS):
            q = keyframes(10 + k, count, step)
            nodes = 100 * (count - 1) + 1
            coarse, fine = (
                least_duration(evenly_paced(q), limits, n) for n in (nodes, 2 * nodes - 1)
            )
            name = f"{count} keyframes {step} rad apart, limits {which}"
            duration = fine + (fine - coarse) / 3
            print(name, coarse, fine, duration, flush=True)
            cases.append(
                {"name": name, "keyframes": q.tolist(), "limits": limits, "duration": duration}
            )
    path = Path(__file__).with_name("optima.json")
    path.write_text(json.dumps(cases, indent=1) + "\n")


if __name__ == "__main__":
    main()
