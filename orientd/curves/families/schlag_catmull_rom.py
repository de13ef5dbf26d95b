"""Schlag's Catmull-Rom curve: the Barry-Goldman triangle with slerp at the keyframes' own times."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import TriangleCurve, catmull_rom_intervals, reflect
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_choice, resolve_times


class SchlagCatmullRom(TriangleCurve):
    r"""Interpolate keyframes by a triangle of slerps over four of them at a time.

    .. math:: \frac{t - t_i}{t_{i+1} - t_i}; \quad
              \frac{t - t_{i-1}}{t_{i+1} - t_{i-1}}, \frac{t - t_i}{t_{i+2} - t_i}; \quad
              \frac{t - t_{i-1}}{t_i - t_{i-1}}, \frac{t - t_i}{t_{i+1} - t_i},
              \frac{t - t_{i+1}}{t_{i+2} - t_{i+1}}

    from the top of the triangle to its base.  Schlag (1991), after Barry and Goldman (1988).  In
    the printed uniform triangle *t* counts from the segment's own start, and the outer slerps of
    the base extrapolate (u = t + 1 and t - 1), so they must not clamp; ``sin(1-u)theta`` there
    reads :math:`\sin((1-u)\theta)`.  The velocity is continuous at the keyframes for any times,
    the acceleration is not.

    Picture: ``orientd plot schlag_catmull_rom``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        ends: ``"phantom"``: the keyframes next to the ends reflected in them,
            :math:`q_0 q_1^{-1} q_0`, and the end intervals mirrored.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "schlag_catmull_rom"
    summary = "Catmull-Rom by a triangle of slerps"
    source = "Schlag 1991, after Barry and Goldman 1988"
    interpolates = True
    local = True
    takes = ("keys", "times", "ends", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        ends: str = "phantom",
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        check_choice(ends, "ends", ("phantom",))
        padded = np.concatenate([reflect(q[1:2], q[:1]), q, reflect(q[-2:-1], q[-1:])])
        before = 2.0 * instants[0] - instants[1]
        after = 2.0 * instants[-1] - instants[-2]
        extended = np.concatenate([[before], instants, [after]])
        window = np.arange(len(q) - 1)[:, None] + np.arange(4)[None, :]
        super().__init__(
            knots=instants,
            points=padded[window],
            intervals=catmull_rom_intervals(extended[window]),
            continuity=1 if len(q) > 2 else 2,
        )
