r"""Products of exponentials: one construction, which families give knots and increments.

.. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_j(t)\bigr)

The functions :math:`\tilde B_j` are cumulative B-splines (Kim, Kim and Shin, 1995), each of which
rises from 0 to 1 over a few knots.  Increments :math:`w_j` are half-angle vectors of any length.
A length above pi is extra winding, which the control quaternions alone do not show.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    CumulativeBasis,
    Indices,
    cumulative_basis,
    inner_multiplicity,
    resolve_knots,
)
from orientd.curves.contract import Curve, takes_common_names
from orientd.curves.keyframes import (
    ParameterError,
    check_aligned,
    check_choice,
    check_integer,
    check_interval,
    check_number,
    check_quaternion,
    check_vector,
    increments,
    resolve_times,
)
from orientd.curves.trajectory import EndState, Trajectory
from orientd.rotation import Floats, between, conjugate, log_half, multiply, nearer_sign

PATHS = ("short", "long", "as_is", "complement")
_COINCIDENT = 1e-14


_CUTS = ((0.01, 1), (0.1, 2))
"""Rad of half angle up to which so many pieces of a trajectory for each span are good mostly."""

_ANY: EndState = (None, None)


class Product(Curve):
    """A cumulative product over a B-spline basis.

    Args:
        basis: the cumulative basis functions that vary on each span.
        controls: control quaternions, shape ``(n + 1, 4)``, the signs as the product needs them.
        increments: half-angle vectors from each control quaternion to the next, ``(n, 3)``.
        continuity: what holds at the knots.
        start: what was asked for at the first instant.
        end: what was asked for at the last instant.
    """

    def __init__(
        self,
        *,
        basis: CumulativeBasis,
        controls: Floats,
        increments: Floats,
        continuity: int,
        start: EndState = _ANY,
        end: EndState = _ANY,
    ) -> None:
        first = basis.first - 1
        parts = controls[first], first, increments, basis.values
        self._set(basis.breaks, parts, continuity, (start, end))

    def _set(
        self,
        breaks: Floats,
        parts: tuple[Floats, Indices, Floats, Floats],
        continuity: int,
        ends: tuple[EndState, EndState],
    ) -> None:
        """Set up the curve.

        Args:
            breaks: where its spans begin and end, s, shape ``(S + 1,)``.
            parts: the quaternion before the product of each span, ``(S, 4)``; the number of its
                first increment, ``(S,)``; all increments, ``(n, 3)``; and the Bernstein
                coefficients of its functions, ``(S, m, m + 1)``.
            continuity: what holds at the breaks.
            ends: what was asked for there.
        """
        super().__init__(knots=breaks, continuity=continuity)
        base, first, vectors, values = parts
        self._parts = (
            np.ascontiguousarray(base),
            np.ascontiguousarray(first, dtype=np.int64),
            np.ascontiguousarray(vectors),
            np.ascontiguousarray(values),
        )
        self._ends = ends

    @property
    def parts(self) -> tuple[Floats, Indices, Floats, Floats]:
        """What it is a product of, as for :meth:`_set`; not to be changed."""
        return self._parts

    @property
    def increments(self) -> Floats:
        """Half-angle vectors from each control quaternion to the next; read only, ``(n, 3)``."""
        view = self._parts[2].view()
        view.setflags(write=False)
        return view

    @cached_property
    def trajectory(self) -> Trajectory:
        """See :attr:`Curve.trajectory`: pieces as short as the largest increment calls for."""
        largest = float(np.max(np.abs(self._parts[2])))
        cuts = next((count for most, count in _CUTS if largest < most), 4)
        return Trajectory.of_product(
            self._knots, self._parts, ends=self._ends, continuity=self.continuity, cuts=cuts
        )


class Slerp(Product):
    r"""Turn at constant angular velocity about one axis.

    .. math:: q(t) = q_0 \exp\bigl(u (\theta + n \pi) a\bigr), \quad u = (t - t_0) / (t_1 - t_0)

    with :math:`\theta a = \log(q_0^{-1} q_1)` in half angles (Shoemake, 1985).  Every uniform turn
    from one orientation to another about one axis is among these.  Nielson's (1993) spin of a
    whole turn prints :math:`\sqrt{2t - 4t^2}`; corrected to :math:`\sqrt{4t - 4t^2}` it still
    starts and ends with unbounded velocity, so it is made with ``spins=1`` and ``axis`` here.

    Picture: ``orientd plot slerp``.

    Args:
        q0: first orientation.
        q1: last orientation.
        t0: first instant, s.
        t1: last instant, s.
        path: ``"short"`` and ``"long"`` choose the sign of *q1*; ``"as_is"`` keeps it;
            ``"complement"`` goes the other way round the great circle of ``"as_is"`` (course
            notes on quaternion interpolation).
        spins: whole turns added, negative ones the other way.
        axis: body axis for orientations that coincide and so leave it open; otherwise not used.

    Raises:
        ValueError: a parameter is not as said, or the axis is open and not given.
    """

    name = "slerp"
    summary = "one great arc at constant velocity, with whole turns if wanted"
    source = "Shoemake 1985"
    interpolates = True
    takes = ("q0", "q1", "t0", "t1", "path", "spins", "axis")

    @takes_common_names
    def __init__(
        self,
        *,
        q0: ArrayLike,
        q1: ArrayLike,
        t0: float = 0.0,
        t1: float = 1.0,
        path: str = "short",
        spins: int = 0,
        axis: ArrayLike | None = None,
    ) -> None:
        start, end = check_quaternion(q0, "q0"), check_quaternion(q1, "q1")
        interval = check_interval(t0, t1)
        path = check_choice(path, "path", PATHS)
        turns = check_integer(spins, "spins")
        relative = between(start, end)
        if path in ("short", "long"):
            relative *= nearer_sign(*relative.tolist()) * (1.0 if path == "short" else -1.0)
        angle = math.atan2(float(np.linalg.norm(relative[1:])), float(relative[0]))
        angle += turns * math.pi - (2.0 * math.pi if path == "complement" else 0.0)
        direction = log_half(relative)
        if np.linalg.norm(relative[1:]) <= _COINCIDENT and abs(angle) > _COINCIDENT:
            if axis is None:
                raise ParameterError(
                    "axis",
                    "axis must be given for a turn between orientations that coincide, got None",
                )
            direction = check_vector(axis, "axis")
        elif axis is not None:
            check_vector(axis, "axis")
        length = float(np.linalg.norm(direction))
        if axis is not None and length == 0.0 and abs(angle) > 0.0:
            raise ParameterError("axis", f"axis must not be zero, got {axis!r}")
        increment = direction * (angle / length if length > 0.0 else 0.0)
        super().__init__(
            basis=cumulative_basis(np.repeat(interval, 2), 2),
            controls=np.stack([start, end]),
            increments=increment[None],
            continuity=2,
        )


class PiecewiseSlerp(Product):
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
        controls = check_aligned(keys, align)
        instants = resolve_times(times, controls)
        knots = np.concatenate([instants[:1], instants, instants[-1:]])
        super().__init__(
            basis=cumulative_basis(knots, 2),
            controls=controls,
            increments=increments(controls),
            continuity=0,
        )


class KksBezier(Product):
    r"""Blend control quaternions with the cumulative Bernstein basis.

    .. math:: q(t) = q_0 \prod_{i=1}^n
              \exp\bigl(\log(q_{i-1}^{-1} q_i)\, \tilde\beta_{i,n}(u)\bigr), \quad
              \tilde\beta_{i,n}(u) = \sum_{j=i}^n \tbinom{n}{j} (1-u)^{n-j} u^j

    Kim, Kim and Shin (1995), eqs. (9) and (10).  The appendix prints the exponent ``n-i`` for
    ``n-j`` in the basis; the body of the paper has it right.  "Order n" there is degree n.

    Picture: ``orientd plot kks_bezier``.

    Args:
        control: at least two control quaternions, the first and last of which are met.
        t0: first instant, s.
        t1: last instant, s.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_bezier"
    summary = "one smooth segment drawn by control orientations"
    source = "Kim, Kim and Shin 1995, eq. (10)"
    takes = ("control", "t0", "t1", "align")

    @takes_common_names
    def __init__(
        self, *, control: ArrayLike, t0: float = 0.0, t1: float = 1.0, align: bool = True
    ) -> None:
        controls = check_aligned(control, align, "control")
        interval = check_interval(t0, t1)
        super().__init__(
            basis=cumulative_basis(np.repeat(interval, len(controls)), len(controls)),
            controls=controls,
            increments=increments(controls),
            continuity=2,
        )


class KksBspline(Product):
    r"""Blend control quaternions with the cumulative B-spline basis; control is local.

    .. math:: q(t) = q_{l-k+1} \prod_{i=l-k+2}^{l}
              \exp\bigl(\log(q_{i-1}^{-1} q_i)\, \tilde B_{i,k}(t)\bigr),
              \quad t_l \le t < t_{l+1}

    Kim, Kim and Shin (1995), sec. 5.3.  Moving control quaternion *l* changes the curve on
    :math:`[t_l, t_{l+k}]` only.  The text names the increments and control quaternions of the
    span form one index too low in places; the formula itself is right.  The appendix defines the
    curve outside the domain by a power of the first quaternion; that is not invariant under a
    change of the world frame, and instants there are refused.

    Picture: ``orientd plot kks_bspline``.

    Args:
        control: control quaternions, at least *order*.
        order: degree plus one, at least 2.
        knots: non-decreasing knots in seconds, ``len(control) + order`` of them, or ``None`` for
            knots one second apart with the domain starting at 0.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_bspline"
    summary = "C2 blending with local control; does not meet its control orientations"
    source = "Kim, Kim and Shin 1995, sec. 5.3"
    local = True
    takes = ("control", "order", "knots", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        control: ArrayLike,
        order: int = 4,
        knots: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        order = check_integer(order, "order", minimum=2)
        controls = check_aligned(control, align, "control", minimum=order)
        vector = resolve_knots(knots, len(controls), order)
        repeated = inner_multiplicity(vector, order)
        super().__init__(
            basis=cumulative_basis(vector, order),
            controls=controls,
            increments=increments(controls),
            continuity=order - 1 - repeated if repeated else 2,
        )


class KksUniform(Product):
    r"""Blend control quaternions at equal intervals, meeting the first and the last.

    .. math:: q(t) = q_{-1} \prod_{i=0}^{n+1}
              \exp\bigl(\log(q_{i-1}^{-1} q_i) \, \tilde B_{i,4}(t)\bigr)

    The cumulative cubic B-spline over the knots :math:`t_i = i - 2`, with phantom control
    quaternions :math:`q_{-1} = q_0 q_1^{-1} q_0` and :math:`q_{n+1} = q_n q_{n-1}^{-1} q_n`, on
    :math:`[0, n]` (Kim, Kim and Shin, 1995, appendix).  The appendix prints the second phantom as
    :math:`q_n q_n^{-1} q_n`, with which the curve misses :math:`q_n`.  Control quaternions inside
    are approached, not met.

    Picture: ``orientd plot kks_uniform``.

    Args:
        control: at least two control quaternions.
        t0: where the domain begins, s.
        t1: where it ends; ``None`` puts the control quaternions one second apart.
        align: whether each takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_uniform"
    summary = "C2 blending at one orientation a second, ends met"
    source = "Kim, Kim and Shin 1995, appendix"
    local = True
    takes = ("control", "t0", "t1", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        control: ArrayLike,
        t0: float = 0.0,
        t1: float | None = None,
        align: bool = True,
    ) -> None:
        inner = check_aligned(control, align, "control")
        before = multiply(multiply(inner[0], conjugate(inner[1])), inner[0])
        after = multiply(multiply(inner[-1], conjugate(inner[-2])), inner[-1])
        controls = np.concatenate([before[None], inner, after[None]])
        spans = len(inner) - 1
        start, end = check_interval(t0, check_number(t0, "t0") + spans if t1 is None else t1)
        knots = start + np.arange(-3.0, spans + 4.0) * ((end - start) / spans)
        knots[3 + spans] = end
        super().__init__(
            basis=cumulative_basis(knots, 4),
            controls=controls,
            increments=increments(controls),
            continuity=2,
        )
