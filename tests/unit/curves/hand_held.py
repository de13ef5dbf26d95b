"""A turning that is known, and what a hand-held sensor makes of it."""

import numpy as np

from orientd import rotation

DROPOUT = (16.5, 17.0)


def truth(t):
    """Return the orientation at instants: sways of one to three seconds, up to 1.5 rad."""
    t = np.asarray(t)
    r = np.stack(
        [
            0.6 * np.sin(1.1 * t),
            0.5 * np.sin(0.8 * t + 1.0) + 0.15 * np.sin(2.6 * t),
            1.5 * np.sin(0.5 * t) + 0.3 * np.sin(1.9 * t + 2.0),
        ],
        axis=-1,
    )
    return rotation.exp(r)


def recorded(seed, *, seconds=60.0, rate_hz=30.0, noise_deg=0.5, wild=8):
    """Return times and orientations: jitter, noise, lost samples, sign flips, wild samples."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    t = t + rng.uniform(-0.002, 0.002, len(t))
    is_there = (rng.uniform(size=len(t)) > 0.08) & ~((t > DROPOUT[0]) & (t < DROPOUT[1]))
    t = t[is_there]
    noise = rotation.exp(np.radians(noise_deg) * rng.normal(size=(len(t), 3)))
    q = rotation.multiply(truth(t), noise) * rng.choice([-1.0, 1.0], size=len(t))[:, None]
    hit = rng.choice(len(t), wild, replace=False)
    q[hit] = rotation.multiply(q[hit], rotation.exp(rng.normal(size=(wild, 3))))
    return t, q
