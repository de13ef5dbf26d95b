"""The least effort through the keyframes of the golden cases, found on fine grids.

`python tests/data/effort/regenerate.py` writes `optima.json` beside it in a few seconds.  For every
golden case with keyframes it minimises the integral of squared angular acceleration, and that of
squared torque for `INERTIA`, directly over the orientations at the points of a grid (Barr, Currin,
Gabriel and Hughes, 1992): the body rate of a piece is the logarithm of its turn over its time, the
acceleration at a point the change of rate, the rate there the mean of its two pieces.  The error is
of second order in the pieces, so that two grids give the limit by Richardson's extrapolation; the
file keeps all three.

Nothing of `minimum_effort` goes into it: the cumulative cubic spline is only the first guess, and
derivatives are differences.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from orientd.curves import METHODS, resolve_times
from orientd.rotation import align, conjugate, exp, log, multiply, normalize

HERE = Path(__file__).parent
GOLDEN = HERE.parent / "golden"
INERTIA = ((1.0, 0.2, 0.0), (0.2, 2.0, -0.3), (0.0, -0.3, 2.5))
"""kg m^2."""

PIECES = (48, 96)
"""Between two keyframes."""

SETTLED = 1e-9
"""Relative decrease of the integral in the last step."""

DIFFERENCE = 1e-6
COLOURS = 3
"""A residual depends on three neighbouring points, so every third may move at once."""


def cases():
    """Yield name, keyframes, times and end velocities of every golden case with keyframes."""
    for path in sorted(GOLDEN.glob("*.json")):
        params = json.loads(path.read_text(encoding="utf-8"))["params"]
        if "keys" in params:
            keys = align(normalize(params["keys"]))
            times = resolve_times(params.get("times", "uniform"), keys)
            yield path.stem, keys, times, params.get("omega_start"), params.get("omega_end")


def clamped(first, last):
    """Return the parameters that prescribe end velocities."""
    ends = {}
    for side, omega in (("start", first), ("end", last)):
        if omega is not None:
            ends |= {side: "clamped", f"omega_{side}": omega}
    return ends


class Grid:
    """Orientations at the points of a grid, and the torques there."""

    def __init__(self, keys, times, pieces, inertia, first, last):
        shares = np.arange(pieces) / pieces
        inner = times[:-1, None] + np.diff(times)[:, None] * shares
        self.times = np.append(inner.ravel(), times[-1])
        self.h = np.diff(self.times)[:, None]
        self.spans = np.concatenate([self.h[:1], self.h[1:] + self.h[:-1], self.h[-1:]]) / 2
        self.inertia, self.first, self.last = inertia, first, last
        self.is_free = np.arange(len(self.times)) % pieces != 0

    def residuals(self, q):
        """Return torques at the points times the root of the time they stand for, ``(n, 3)``."""
        rates = log(multiply(conjugate(q[:-1]), q[1:])) / self.h
        start = rates[0] if self.first is None else np.asarray(self.first)
        end = rates[-1] if self.last is None else np.asarray(self.last)
        all_rates = np.concatenate([[start], rates, [end]])
        omega = 0.5 * (all_rates[1:] + all_rates[:-1])
        if self.first is not None:
            omega[0] = start
        if self.last is not None:
            omega[-1] = end
        alpha = np.diff(all_rates, axis=0) / self.spans
        torque = alpha @ self.inertia + np.cross(omega, omega @ self.inertia)
        # At a free end there is no torque.
        if self.first is None:
            torque[0] = 0.0
        if self.last is None:
            torque[-1] = 0.0
        return np.sqrt(self.spans) * torque

    def step(self, q, damping):
        """Return the damped Gauss-Newton step as body rotation vectors."""
        count, base = len(q), self.residuals(q)
        rows, columns, values = [], [], []
        points = np.arange(count)
        for colour in range(COLOURS):
            is_moved = self.is_free & (points % COLOURS == colour)
            source = np.clip(points + (colour - points + 1) % COLOURS - 1, 0, count - 1)
            for axis in range(3):
                move = np.zeros((count, 3))
                move[is_moved, axis] = DIFFERENCE
                plus = self.residuals(multiply(q, exp(move)))
                minus = self.residuals(multiply(q, exp(-move)))
                change = (plus - minus) / (2.0 * DIFFERENCE)
                for part in range(3):
                    rows.append(3 * points + part)
                    columns.append(3 * source + axis)
                    values.append(change[:, part] * is_moved[source])
        shape = (3 * count, 3 * count)
        entries = (np.concatenate(rows), np.concatenate(columns))
        jacobian = coo_matrix((np.concatenate(values), entries), shape=shape).tocsc()
        normal = jacobian.T @ jacobian
        diagonal = normal.diagonal()
        pinned = np.where(np.repeat(self.is_free, 3), damping * diagonal, 1.0)
        normal = normal + coo_matrix((pinned, (np.arange(3 * count),) * 2), shape=shape)
        return -spsolve(normal.tocsc(), jacobian.T @ base.ravel()).reshape(count, 3)

    def minimise(self, q):
        """Return the least sum of squares, and the orientations that have it."""
        value, damping = np.sum(self.residuals(q) ** 2), 1e-6
        while damping < 1e6:
            moved = normalize(multiply(q, exp(self.step(q, damping))))
            reached = np.sum(self.residuals(moved) ** 2)
            if reached < value:
                decrease = (value - reached) / value
                q, value, damping = moved, reached, 0.2 * damping
                if decrease < SETTLED:
                    break
            else:
                damping = 10.0 * damping
        return float(value), q


def optimum(keys, times, inertia, first, last):
    """Return the least integral on the two grids, and its limit."""
    guess = METHODS["c2_cumulative"](keys=keys, times=times, **clamped(first, last))
    values = []
    for pieces in PIECES:
        grid = Grid(keys, times, pieces, np.asarray(inertia), first, last)
        q = guess.evaluate(grid.times)[0]
        on_keys = np.flatnonzero(~grid.is_free)
        q[on_keys] = keys * np.sign(np.sum(keys * q[on_keys], axis=1, keepdims=True))
        values.append(grid.minimise(q)[0])
    coarse, fine = values
    return {"coarse": coarse, "fine": fine, "limit": fine + (fine - coarse) / 3.0}


def main():
    """Write the file."""
    found = {}
    for name, keys, times, first, last in cases():
        found[name] = {
            "acceleration": optimum(keys, times, np.eye(3), first, last),
            "torque": optimum(keys, times, INERTIA, first, last),
        }
        print(name, found[name], flush=True)
    text = json.dumps({"inertia": INERTIA, "pieces": PIECES, "optima": found}, indent=1)
    (HERE / "optima.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
