"""Nielson and Shieh's circle spline: rational quadratic arcs of circles joined with one tangent."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import Jet, best_direction, frame_of, rates, unit
from orientd.curves.contract import Curve, Samples, takes_common_names
from orientd.curves.keyframes import (
    ParameterError,
    check_aligned,
    check_bool,
    check_number,
    check_vector,
    resolve_times,
)
from orientd.errors import PlanError
from orientd.rotation import Floats


class NielsonShieh(Curve):
    r"""Join keyframes by circular arcs on the sphere that share their tangents.

    .. math:: c_i(t) = \frac{q_i (1-t)^2 + 2 w_i M_i (1-t) t + q_{i+1} t^2}
              {(1-t)^2 + 2 w_i (1-t) t + t^2}, \quad
              w_i = \pm\sqrt{\frac{1 - q_i \cdot q_{i+1}}{2 (\|M_i\|^2 - 1)}}

    Nielson (1993), eqs. 10 to 15, whose denominator prints :math:`w_i^2 (1-t) t`; the middle term
    is :math:`2 w_i (1-t) t`, and the curve has unit norm with it only.  The shoulder point
    :math:`M_i` is where the tangents at both keyframes meet; keyframe *i* lies on the line
    through :math:`M_{i-1}` and :math:`M_i` (the text says the next one).  With the unit tangent
    :math:`T_i` at keyframe *i* and the chord :math:`d_i = \|q_{i+1} - q_i\|` everything follows
    without a shoulder at infinity: the tangent is mirrored across each chord,
    :math:`T_{i+1} = 2 (T_i \cdot n_i) n_i - T_i`, and :math:`w_i = T_i \cdot q_{i+1} / d_i`,
    :math:`w_i M_i = w_i q_i + \tfrac12 d_i T_i`.

    So the first tangent, or the first shoulder point, decides the whole curve.  Equation 12 makes
    three points collinear, but does not put the keyframe between the shoulder points; where it is
    outside, the weight turns negative and the arc is the complementary one, the long way around.
    Whether a first tangent without negative weights exists is decided by the intersection of as
    many half spaces of three dimensions as there are arcs: for random keyframes in 88 % of cases
    with 5 of them, 34 % with 8, 12 % with 10, none with 20; for densely sampled smooth paths in
    most.

    The arcs join with the same tangent but not the same speed: the C1 the paper claims needs its
    :math:`t = s / (a_i + (1 - a_i) s)` (eq. 15) with
    :math:`a_i a_{i+1} = (d_{i+1}/h_{i+1}) / (d_i/h_i)`, of which :math:`a_1` is free.  Their
    logarithms add up with alternating signs, so over many intervals out of proportion to their
    chords they drift apart and the speed within the arcs becomes uneven without bound.

    Picture: ``orientd plot nielson_shieh``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two, neighbours different.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        M1: the first shoulder point, a point of four-dimensional space, projected on its plane
            :math:`(M, q_1) = (M, q_2) = 1`; without it the one that *criterion* likes best.
        criterion: 13, least length of the shoulder polygon, or 14, least squared distance of the
            arcs' middles from their shoulder points.
        reparam: whether to apply eq. 15 and be C1.
        a1: of eq. 15, positive; or ``"balanced"``, least sum of squared logarithms of all.
        require_positive: whether the search for *M1* is among those without a negative weight
            only.  A given *M1* is taken at its word.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: every first shoulder point makes some weight negative, and *require_positive*.
    """

    name = "nielson_shieh"
    summary = "circular arcs with common tangents"
    source = "Nielson 1993, eqs. 10 to 15"
    interpolates = True
    takes = ("keys", "times", "M1", "criterion", "reparam", "a1", "require_positive", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        M1: ArrayLike | None = None,  # noqa: N803 - the paper's name, in every motion file
        criterion: int = 13,
        reparam: bool = True,
        a1: float | str = "balanced",
        require_positive: bool = True,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        check_criterion(criterion, (13, 14))
        is_restricted = check_bool(require_positive, "require_positive")
        is_smooth = check_bool(reparam, "reparam")
        super().__init__(knots=instants, continuity=2 if len(q) == 2 else 1 if is_smooth else 0)
        chords = check_chords(q)
        basis = carried_bases(q, chords)
        # A tangent is at right angles to its own keyframe, and the way to the next one is exact.
        ways = np.diff(q, axis=0) / chords[:, None]
        if M1 is None:
            pulls = np.einsum("ncj,nc->nj", basis, ways)
            direction = best_direction(pulls, chords, criterion, is_restricted=is_restricted)
            if direction is None:
                raise PlanError(
                    "every first shoulder point makes a weight of the circle spline negative: "
                    "give M1, or require_positive=False to take complementary arcs"
                )
        else:
            direction = basis[0].T @ projected_tangent(check_vector(M1, "M1", 4), q)
        tangents = basis @ (direction / np.linalg.norm(direction))
        self._weights = np.sum(tangents * ways, axis=-1)
        self._keys, self._chords = q, chords
        self._middles = self._weights[:, None] * q[:-1] + 0.5 * chords[:, None] * tangents
        h = np.diff(instants)
        self._slopes = 1.0 / h
        self._ratios = speed_ratios(chords / h, a1) if is_smooth else np.ones(len(h))

    @property
    def weights(self) -> Floats:
        """Weights of the shoulder points, negative for a complementary arc, ``(n - 1,)``."""
        weights: Floats = self._weights.copy()
        return weights

    @property
    def shoulders(self) -> Floats:
        """Shoulder points, of norm above one, shape ``(n - 1, 4)``; infinite for weight zero."""
        with np.errstate(divide="ignore"):
            points: Floats = self._middles / self._weights[:, None]
        return points

    @np.errstate(divide="ignore", invalid="ignore")  # what has no ratio of speeds is not a number
    def _sample(self, times: Floats) -> Samples:
        span = self._segments(times)
        slope, a = self._slopes[span], self._ratios[span]
        s = (times - self._knots[span]) * slope
        below = a + (1.0 - a) * s
        first = a * slope / (below * below)
        t = Jet(s / below, first, -2.0 * first * (1.0 - a) * slope / below)
        rest = Jet(a * (1.0 - s) / below, -t.first, -t.second)
        arc = (
            (rest * rest).widened().times(self._keys[span])
            + (rest * t).widened().times(2.0 * self._middles[span])
            + (t * t).widened().times(self._keys[span + 1])
        )
        return rates(unit(arc))


def check_criterion(criterion: object, allowed: tuple[int, int]) -> None:
    """Refuse a criterion that is not one of two equation numbers.

    Raises:
        ValueError: it is not.
    """
    if isinstance(criterion, bool) or criterion not in allowed:
        raise ParameterError(
            "criterion", f"criterion must be {allowed[0]} or {allowed[1]}, got {criterion!r}"
        )


def check_chords(q: Floats) -> Floats:
    """Return the distances between neighbouring keyframes, shape ``(n - 1,)``.

    Raises:
        ValueError: two neighbours are the same, or opposite points of the sphere.
    """
    chords: Floats = np.sqrt(np.sum((q[1:] - q[:-1]) ** 2, axis=-1))
    for is_bad, said in ((chords < 1e-14, "the same"), (chords > 2.0 - 1e-14, "opposite")):
        if np.any(is_bad):
            place = int(np.argmax(is_bad))
            raise ParameterError(
                "keys",
                "keys must have neighbours that differ by less than a whole turn for a circle "
                f"through them, got keys[{place}] and keys[{place + 1}] {said}",
            )
    return chords


def carried_bases(q: Floats, chords: Floats) -> Floats:
    """Return a basis of the first tangent space and its mirror images at the other keyframes.

    Returns:
        Columns in the tangent space of keyframe *i*, shape ``(n - 1, 4, 3)``.
    """
    basis = frame_of(q)[:, 1:]
    normals = (q[1:] - q[:-1]) / chords[:, None]
    carried: Floats = np.empty((len(chords), 4, 3))
    for i, normal in enumerate(normals):
        carried[i] = basis
        basis = 2.0 * np.outer(normal, normal @ basis) - basis
    return carried


def projected_tangent(shoulder: Floats, q: Floats) -> Floats:
    """Return the tangent at the first keyframe towards a shoulder point made to fit.

    The point is projected on the plane of points whose products with both keyframes are one.  A
    shoulder given for the negated quaternions is negated.
    """
    half_sum, half_difference = 0.5 * (q[0] + q[1]), 0.5 * (q[1] - q[0])
    if float(shoulder @ half_sum) < 0.0:
        shoulder = -shoulder
    for direction in (half_sum, half_difference):
        shoulder = shoulder - float(shoulder @ direction) / float(direction @ direction) * direction
    tangent: Floats = shoulder + half_sum / float(half_sum @ half_sum) - q[0]
    return tangent


def speed_ratios(speeds: Floats, a1: float | str) -> Floats:
    r"""Return the :math:`a_i` of eq. 15 that make the speed continuous.

    Args:
        speeds: chord over interval of each segment, shape ``(n,)``.
        a1: the first, or ``"balanced"``.

    Raises:
        ValueError: *a1* is neither a positive number nor the word.
    """
    signs = np.where(np.arange(len(speeds)) % 2 == 0, 1.0, -1.0)
    logs: Floats = np.zeros(len(speeds))
    logs[1:] = -signs[1:] * np.cumsum(signs[1:] * -np.diff(np.log(speeds)))
    if isinstance(a1, str):
        if a1 != "balanced":
            raise ParameterError("a1", f"a1 must be a positive number or 'balanced', got {a1!r}")
        shift = -float(np.mean(signs * logs))
    else:
        first = check_number(a1, "a1")
        if first <= 0.0:
            raise ParameterError("a1", f"a1 must be a positive number or 'balanced', got {a1!r}")
        shift = float(np.log(first))
    ratios: Floats = np.exp(logs + signs * shift)
    return ratios
