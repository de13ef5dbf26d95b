"""The cumulative B-spline of least effort through keyframes: closed form, near the optimum."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    CumulativeBasis,
    Indices,
    cumulative_basis,
    outer_derivatives,
)
from orientd.curves.contract import takes_common_names
from orientd.curves.family import END_STATES
from orientd.curves.keyframes import (
    ParameterError,
    check_aligned,
    check_end,
    check_integer,
    resolve_times,
)
from orientd.curves.optimal.effort_equations import EffortEquations, EndRows
from orientd.curves.optimal.effort_search import least_effort, refined, search
from orientd.curves.optimal.starts import start_path
from orientd.curves.products import Product
from orientd.errors import PlanError
from orientd.rotation import Floats, angle, exp_half, multiply, rotate

DIVISIONS = (1, 2, 4)
"""Into how many times as many spans an interval is divided until the effort is below that of the
spline to start from: one that turns by radians in a span is not near one over finer knots."""

FEWEST = 2
"""Spans from which the search begins where it does not settle with more."""

WIDE = 2.2
"""Rad between keyframes, beyond which torque changes so much that two more spans are taken."""

ENDS = ("natural", "clamped", "state")

End = tuple[Floats | None, Floats | None]
"""Angular velocity and acceleration that are given at an end."""


class MinimumEffort(Product):
    r"""Pass through keyframes with little torque: of all splines on a grid the one of least effort.

    .. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_{j,k}(t)\bigr), \qquad
              \min_w \int \|I \dot\Omega + \Omega \times I \Omega\|^2 dt

    The problem that Kim, Kim and Shin (1995), sec. 7, leave open, and that Barr, Currin, Gabriel
    and Hughes (1992) solve for points on a grid.  Each interval between keyframes is divided in
    equal spans, so that the cumulative B-spline has more increments *w* than the keyframes settle,
    and what is free minimises the integral: of squared torque for an inertia *I*, of squared
    angular acceleration without one.  Derivatives are those of Sommer et al. (2020); a Gauss-Newton
    step is one banded system, so that building takes time in proportion to the keyframes.

    For acceleration a cubic is within 0.8 % (two spans) or 0.3 % (three) of the least integral
    there is (``min_acceleration``) for steps up to 170 degrees, where ``c2_cumulative`` takes up to
    10 % more; with steps of 10 degrees all three agree to 0.02 %.  Torque changes more within an
    interval and wants order 6, and two more spans where keyframes are far apart: with steps of up
    to 170 degrees two spans are then within 1 % and three within 0.5 %, where a cubic of two
    spans takes 10 % more and ``c2_cumulative`` more still.

    It is a stationary curve near the cumulative spline; large steps may have better ones further
    away.  For torque the search is made twice where up to ten keyframes are more than 2 rad apart,
    from that spline and from the least acceleration, and the better one is taken.  A fast end
    coasts through whole turns where that takes less.  A turn asked for could not be kept: two of
    them are no minimum, but unwind.

    * ``"natural"``: velocity free and no acceleration; with an inertia both are free, and the
      torque there is small, as at the end of the best curve there is none;
    * ``"clamped"``: the angular velocity given;
    * ``"state"``: angular velocity and acceleration given.

    Picture: ``orientd plot minimum_effort``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        inertia: about the body's axes, kg m^2, symmetric and positive definite, shape ``(3, 3)``,
            or principal moments, shape ``(3,)``.
        order: degree of the spline plus one, 4 to 6; without it 4 for acceleration, 6 for torque.
        smoothness: how many derivatives are continuous at the keyframes, 2 to ``order - 2``, which
            is what they are between them; more cost 1 to 3 % of effort.
        spans: of the spline between two keyframes, 2 to 8; without it 2, or 3 for torque where
            *order* is left open, too; more where these take more effort than ``c2_cumulative``, as
            they may with several radians in a span.
        start: condition at the first keyframe.
        end: condition at the last keyframe.
        omega_start: body angular velocity at the first keyframe, rad/s.
        omega_end: body angular velocity at the last keyframe, rad/s.
        alpha_start: body angular acceleration at the first keyframe, rad/s^2.
        alpha_end: body angular acceleration at the last keyframe, rad/s^2.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: the search does not settle.
    """

    name = "minimum_effort"
    summary = "C2 spline of least squared acceleration or torque, end velocities met"
    source = "Kim, Kim and Shin 1995, sec. 7; Sommer et al. 2020"
    interpolates = True
    meets_end_velocities = True
    meets_end_accelerations = True
    takes = ("keys", "times", "inertia", "order", "smoothness", "spans", *END_STATES, "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        order: int | None = None,
        smoothness: int = 2,
        spans: int | None = None,
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        alpha_start: ArrayLike | None = None,
        alpha_end: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        matrix = None if inertia is None else check_inertia(inertia)
        usual, usual_spans = (4, 2) if matrix is None else (6, 2 if order else 3)
        k = usual if order is None else _check_between(order, "order", 4, 6)
        smooth = _check_between(smoothness, "smoothness", 2, k - 2)
        pieces = usual_spans if spans is None else _check_between(spans, "spans", 2, 8)
        first = check_end(start, "start", omega_start, alpha_start, ENDS)
        last = check_end(end, "end", omega_end, alpha_end, ENDS)
        path, q = start_path(q, instants, first[0], last[0])
        has_acceleration = first[1] is not None or last[1] is not None
        pose = partial(_Posed, q, instants, k, smooth, (first, last), matrix)
        problem = PlanError(_WORSE)
        counts = [more * pieces for more in DIVISIONS]
        for count in counts if FEWEST in counts else [*counts, FEWEST]:
            posed = pose(count)
            try:
                solved = search(posed.equations, path, posed.knots, k, (first[0], last[0]))
            except PlanError as error:
                problem = error
                continue
            # The spline to start from knows nothing of accelerations at its ends.
            if has_acceleration or posed.equations.is_better(solved, path):
                break
        else:
            raise problem
        is_wide = matrix is not None and bool(np.any(angle(q[1:], q[:-1]) > WIDE))
        wanted = max(count, pieces + 2 * is_wide)
        if wanted > count:
            finer = pose(wanted)
            with suppress(PlanError):
                guess = refined(posed.curve(solved).evaluate, finer.knots, k)
                posed, solved = finer, least_effort(finer.equations, guess)
        super().__init__(**posed.parts(solved), start=first, end=last)


class _Posed:
    """What is to be found on a grid of so many spans between two keyframes."""

    def __init__(
        self,
        keys: Floats,
        instants: Floats,
        order: int,
        smoothness: int,
        ends: tuple[End, End],
        inertia: Floats | None,
        spans: int,
    ) -> None:
        self.knots = effort_knots(instants, order, spans, order - 1 - smoothness)
        self._basis = cumulative_basis(self.knots, order)
        self._places = np.minimum(spans * np.arange(len(instants)), len(self._basis.first))
        self._keys, self._smoothness = keys, smoothness
        self.equations = EffortEquations(
            basis=self._basis,
            places=self._places,
            keys=keys,
            ends=_end_rows(self._basis, *ends, is_free=inertia is not None),
            inertia=inertia,
        )

    def parts(self, solved: Floats) -> dict[str, Any]:
        """Return what the curve of increments is made of."""
        controls = _controls(self._basis, self._places, self._keys, solved)
        return {
            "basis": self._basis,
            "controls": controls,
            "increments": solved,
            "continuity": self._smoothness,
        }

    def curve(self, solved: Floats) -> Product:
        """Return the curve of increments."""
        return Product(**self.parts(solved))


_WORSE = (
    "no curve of less effort than c2_cumulative was found: take more spans, add keyframes, lower "
    "the end velocities or make neighbouring intervals more alike"
)


def check_inertia(inertia: ArrayLike) -> Floats:
    """Return an inertia over its largest moment: the effort is least where it was.

    Raises:
        ValueError: it is not a symmetric positive definite matrix or three positive moments.
    """
    expected = "inertia must be three moments or a symmetric positive definite 3x3 matrix, got"
    try:
        matrix = np.asarray(inertia, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError("inertia", f"{expected} {inertia!r}") from error
    if matrix.shape == (3,):
        matrix = np.diag(matrix)
    if matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)):
        raise ParameterError("inertia", f"{expected} {inertia!r}")
    moments = np.linalg.eigvalsh(matrix)
    if not moments[0] > 0.0 or np.max(np.abs(matrix - matrix.T)) > 1e-9 * moments[-1]:
        raise ParameterError("inertia", f"{expected} {inertia!r}")
    scaled: Floats = 0.5 * (matrix + matrix.T) / moments[-1]
    return scaled


def effort_knots(instants: Floats, order: int, spans: int, multiplicity: int) -> Floats:
    """Return the knots: each interval in equal spans, those at the keyframes so often repeated.

    >>> effort_knots(np.array([0.0, 1.0, 3.0]), 4, 2, 1).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0]
    """
    shares = np.arange(spans) / spans
    inner = instants[:-1, None] + np.diff(instants)[:, None] * shares
    repeated = np.repeat(inner, [multiplicity] + [1] * (spans - 1), axis=1).ravel()
    ends = np.repeat(instants[0], order), np.repeat(instants[-1], order)
    return np.concatenate([ends[0], repeated[multiplicity:], ends[1]])


def _check_between(value: object, name: str, least: int, most: int) -> int:
    number = check_integer(value, name)
    if not least <= number <= most:
        allowed = str(least) if least == most else f"{least} to {most}"
        raise ParameterError(name, f"{name} must be {allowed}, got {value!r}")
    return number


def _end_rows(
    basis: CumulativeBasis,
    first: End,
    last: End,
    *,
    is_free: bool,
) -> EndRows:
    """Return what the ends ask of the two outermost increments there."""
    final = int(basis.first[-1]) + basis.values.shape[1] - 2
    rows: list[tuple[tuple[int, int], ArrayLike, Floats]] = []
    for (omega, alpha), outer, inner in ((first, 0, 1), (last, final, final - 1)):
        slopes, curvatures, _ = outer_derivatives(basis, is_end=outer > 0)
        if omega is None:
            if not is_free:
                scaled = curvatures[:2] / np.max(np.abs(curvatures[:2]))
                rows.append(((outer, inner), scaled, np.zeros(3)))
            continue
        settled = omega / (2.0 * slopes[0])
        rows.append(((outer, outer), (1.0, 0.0), settled))
        if alpha is not None:
            # Seen from the end, the turn of the last factor stands before the others.
            half = 0.5 * alpha if outer == 0 else rotate(exp_half(settled), 0.5 * alpha)
            rows.append(
                ((inner, inner), (1.0, 0.0), (half - curvatures[0] * settled) / curvatures[1])
            )
    index, factors, known = zip(*rows, strict=True) if rows else ((), (), ())
    return EndRows(
        index=np.array(index, dtype=np.intp).reshape(-1, 2),
        factors=np.array(factors).reshape(-1, 2),
        known=np.array(known).reshape(-1, 3),
    )


def _controls(basis: CumulativeBasis, places: Indices, keys: Floats, solved: Floats) -> Floats:
    """Return the control quaternions; those a span starts from are reached from its keyframe."""
    first = basis.first - 1
    controls: Floats = np.zeros((len(solved) + 1, 4))
    here = places[:-1]
    before = keys[:-1]
    for f in reversed(range(basis.values.shape[1])):
        undone = -basis.values[here, f, 0, None] * solved[first[here] + f]
        before = multiply(before, exp_half(undone))
    controls[first[here]] = before
    for span in np.setdiff1d(np.arange(len(first)), here):
        j = int(first[span])
        controls[j] = multiply(controls[j - 1], exp_half(solved[j - 1]))
    return controls
