"""What a series of setpoints reaches, differentiated from first principles.

Nothing of orientd is used here, so that no mistake of the guard or the planner is shared.
"""

import numpy as np


def reached(q, position, period):
    """Return the largest backward differences of setpoints that begin and end at rest.

    Args:
        q: orientations ``(w, x, y, z)``, shape ``(n, 4)``, of either sign.
        position: m, shape ``(n, 3)``.
        period: s.

    Returns:
        Angular velocity, acceleration and jerk, velocity and acceleration of the position, in SI:
        norms, by name.
    """
    q, position = np.asarray(q, np.longdouble), np.asarray(position, np.longdouble)
    assert np.isfinite(q).all()
    assert np.isfinite(position).all()
    assert np.abs((q * q).sum(1) - 1.0).max() < 1e-9
    hold = [0] * 3 + list(range(len(q))) + [len(q) - 1] * 3
    omega = _turns(q[hold]) / period
    velocity = np.diff(position[hold], axis=0) / period
    alpha, push = np.diff(omega, axis=0) / period, np.diff(velocity, axis=0) / period
    jerk = np.diff(alpha, axis=0) / period
    found = {
        "velocity": omega,
        "acceleration": alpha,
        "jerk": jerk,
        "linear_velocity": velocity,
        "linear_acceleration": push,
    }
    return {name: float(np.sqrt((v * v).sum(1)).max()) for name, v in found.items()}


def _turns(q):
    """Return the rotation vector of each step, shape ``(n - 1, 3)``, by its matrix."""
    w, x, y, z = q.T
    # The three columns of the rotation matrix; R_k^T R_k+1 turns from one to the next.
    r = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    step = np.einsum("nji,njk->nik", r[:-1], r[1:])
    # Twice the sine of the angle along the axis, and twice its cosine.
    axis = np.stack(
        [
            step[:, 2, 1] - step[:, 1, 2],
            step[:, 0, 2] - step[:, 2, 0],
            step[:, 1, 0] - step[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.sqrt((axis * axis).sum(1))
    angle = np.arctan2(sine, np.trace(step, axis1=1, axis2=2) - 1)
    return axis * np.where(sine > 0, angle / np.where(sine > 0, sine, 1), 0.5)[:, None]
