"""Piecewise slerp: great arcs from keyframe to keyframe at constant angular velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.contract import Curve, Samples, takes_common_names
from orientd.curves.keyframes import check_aligned, increments, resolve_times
from orientd.rotation import Floats, exp_half, multiply


class PiecewiseSlerp(Curve):
    r"""Join keyframes by great arcs; the angular velocity jumps at every keyframe.

    .. math:: q(t) = q_i \exp\bigl(u \log(q_i^{-1} q_{i+1})\bigr), \quad
              u = (t - t_i) / (t_{i+1} - t_i)

    Shoemake (1985); Kim, Kim and Shin (1995), sec. 4.1.  The ramp printed there rises on
    ``[i-1, i]`` while the text wants the arc from ``q_i`` to ``q_{i+1}``: read
    ``q_i exp(w_{i+1} alpha_{i+1})``.

    Picture: ``orientd plot piecewise_slerp``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        align: whether each keyframe takes the sign nearer to its predecessor; if not, steps are
            as given and may be up to a whole turn.

    Raises:
        ValueError: a parameter is not as said.

    Example:
        >>> curve = PiecewiseSlerp(keys=[[1, 0, 0, 0], [0, 0, 0, 1]], times=[0.0, 2.0])
        >>> q, omega_body, alpha_body = curve.evaluate([1.0])
        >>> omega_body.round(6).tolist()
        [[0.0, 0.0, 1.570796]]
    """

    name = "piecewise_slerp"
    summary = "great arcs between keyframes, velocity jumps at each"
    source = "Shoemake 1985; Kim, Kim and Shin 1995, sec. 4.1"
    interpolates = True
    local = True
    takes = ("keys", "times", "align")

    @takes_common_names
    def __init__(
        self, *, keys: ArrayLike, times: str | ArrayLike | None = None, align: bool = True
    ) -> None:
        self._keys = check_aligned(keys, align)
        resolved = resolve_times(times, self._keys)
        super().__init__(knots=resolved, continuity=0)
        self._rates = increments(self._keys) / np.diff(resolved)[:, None]

    def _sample(self, times: Floats) -> Samples:
        span = self._segments(times)
        elapsed = times - self._knots[span]
        rate = self._rates[span]
        q = multiply(self._keys[span], exp_half(rate * elapsed[:, None]))
        return q, 2.0 * rate, np.zeros_like(rate)
