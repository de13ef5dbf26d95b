"""Nielson's families with a free first inner control point, and the search for it.

Nielson and Shieh's circle spline joins arcs of circles.  The spherical quadratic joins triangles of
slerps over three points.  In both, each inner control point follows from the one before it, so the
first one determines the whole curve.  If the caller gives no first one, a multistart search
minimises a criterion of the papers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.contract import Through
from orientd.curves.keyframes import (
    ParameterError,
    check_bool,
    check_number,
    check_quaternion,
    check_vector,
)
from orientd.curves.newton import cross, differences, multistart
from orientd.curves.triangles import TriangleCurve
from orientd.errors import PlanError
from orientd.rotation import (
    Floats,
    between,
    conjugate,
    exp_half,
    log_half,
    multiply,
    normalize,
    slerp,
)

GRID = 600
"""First tangents in the search for a circle spline."""

SCREENED = 512
"""Pairs of first points in the search for a spherical quadratic."""

WORK = 65536
"""Bound of candidates times length: long chains are screened with fewer candidates."""

KINKS = 64
"""Most keyframes for which the search also examines corners of the polygon's length."""

AROUND = 32
"""Places along such a corner from which the search for a minimum may start."""

ROUNDS = 200
"""Corners that the search for the inside of a cone takes in one after the other, at most."""

STARTS = 10
LONGEST = 2000
"""Bound of starts times length: long chains descend from fewer starts."""


class NielsonShieh(Through):
    r"""Join keyframes by circular arcs on the sphere that share their tangents.

    .. math:: c_i(t) = \frac{q_i (1-t)^2 + 2 w_i M_i (1-t) t + q_{i+1} t^2}
              {(1-t)^2 + 2 w_i (1-t) t + t^2}, \quad
              w_i = \pm\sqrt{\frac{1 - q_i \cdot q_{i+1}}{2 (\|M_i\|^2 - 1)}}

    Nielson (1993), eqs. 10 to 15.  The printed denominator has :math:`w_i^2 (1-t) t`; the curve has
    unit norm only with the middle term :math:`2 w_i (1-t) t`.  The inner control point :math:`M_i`
    is the intersection of the tangents at both keyframes.  Keyframe *i* lies on the line through
    :math:`M_{i-1}` and :math:`M_i` (the text says the next one).

    Let :math:`T_i` be the unit tangent at keyframe *i* and :math:`d_i = \|q_{i+1} - q_i\|` the
    chord.  The following formulas need no inner point at infinity.  The tangent is mirrored across
    each chord, :math:`T_{i+1} = 2 (T_i \cdot n_i) n_i - T_i`, and :math:`w_i = T_i \cdot q_{i+1} /
    d_i`, :math:`w_i M_i = w_i q_i + \tfrac12 d_i T_i`.

    So the first tangent, or the first inner control point, determines the whole curve.  Equation 12
    makes three points collinear, but does not put the keyframe between the inner control points.
    If it is outside, the weight is negative and the arc is the complementary one, the long way
    around.  A first tangent without negative weights exists if as many half spaces of three
    dimensions as there are arcs intersect.  For random keyframes this holds in 88 % of cases with 5
    of them, 34 % with 8, 12 % with 10, and none with 20.  For densely sampled smooth paths it holds
    in most cases.

    The arcs join with the same tangent but not the same speed.  The C1 continuity that the paper
    claims needs its :math:`t = s / (a_i + (1 - a_i) s)` (eq. 15) with :math:`a_i a_{i+1} =
    (d_{i+1}/h_{i+1}) / (d_i/h_i)`, where :math:`a_1` is free.  The logarithms of *a* add up with
    alternating signs.  If many intervals are out of proportion to their chords, these drift apart,
    and the speed within the arcs becomes arbitrarily uneven.

    Picture: ``orientd plot nielson_shieh``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two, neighbours different.
        M1: the first inner control point, a point of four-dimensional space, projected on its
            plane :math:`(M, q_1) = (M, q_2) = 1`; by default the one that minimises *criterion*.
        criterion: 13, the length of the polygon of inner control points, or 14, the squared
            distances of the arcs' middles from their inner control points.
        reparam: whether to apply eq. 15 and be C1.
        a1: parameter of eq. 15, positive; or ``"balanced"`` for the least sum of squared
            logarithms.
        require_positive: whether the search for *M1* excludes negative weights.  It does not apply
            to a given *M1*.

    Raises:
        PlanError: with *require_positive*, every first inner control point makes some weight
            negative.
    """

    name = "nielson_shieh"
    summary = "circular arcs with common tangents"
    source = "Nielson 1993, eqs. 10 to 15"
    own: ClassVar[Mapping[str, Any]] = {
        "M1": None,
        "criterion": 13,
        "reparam": True,
        "a1": "balanced",
        "require_positive": True,
    }

    def _solve(
        self,
        q: Floats,
        instants: Floats,
        *,
        M1: ArrayLike | None,  # noqa: N803 - the paper's name, in every motion file
        criterion: int,
        reparam: bool,
        a1: float | str,
        require_positive: bool,
    ) -> None:
        check_criterion(criterion, (13, 14))
        is_restricted = check_bool(require_positive, "require_positive")
        is_smooth = check_bool(reparam, "reparam")
        self._set_knots(instants, 2 if len(q) == 2 else int(is_smooth))
        chords = check_chords(q)
        basis = carried_bases(q, chords)
        # A tangent is perpendicular to its own keyframe, and the way to the next one is exact.
        ways = np.diff(q, axis=0) / chords[:, None]
        if M1 is None:
            pulls = np.einsum("ncj,nc->nj", basis, ways)
            direction = best_direction(pulls, chords, criterion, is_restricted=is_restricted)
            if direction is None:
                raise PlanError(
                    "every first inner control point makes a weight of the circle spline negative: "
                    "give M1, or require_positive=False to take complementary arcs"
                )
        else:
            direction = basis[0].T @ projected_tangent(check_vector(M1, "M1", 4), q)
        tangents = basis @ (direction / np.linalg.norm(direction))
        self._weights = np.sum(tangents * ways, axis=-1)
        self._keys = q
        self._middles = self._weights[:, None] * q[:-1] + 0.5 * chords[:, None] * tangents
        h = np.diff(instants)
        self._ratios = speed_ratios(chords / h, a1) if is_smooth else np.ones(len(h))

    @property
    def weights(self) -> Floats:
        """Weights of the inner control points, negative for a complementary arc, ``(n - 1,)``."""
        weights: Floats = self._weights.copy()
        return weights

    @property
    def shoulders(self) -> Floats:
        """Inner control points, of norm above one, ``(n - 1, 4)``; infinite for weight zero."""
        with np.errstate(divide="ignore"):
            points: Floats = self._middles / self._weights[:, None]
        return points

    @np.errstate(divide="ignore", invalid="ignore")  # an infinite ratio of speeds gives no number
    def _orientations(self, times: Floats) -> Floats:
        span, s = self._shares(times)
        a = self._ratios[span]
        below = a + (1.0 - a) * s
        t, rest = (s / below)[:, None], (a * (1.0 - s) / below)[:, None]
        return normalize(
            rest * rest * self._keys[span]
            + 2.0 * rest * t * self._middles[span]
            + t * t * self._keys[span + 1]
        )


class SphericalQuadratic(TriangleCurve, Through):
    r"""Join keyframes by quadratic slerp segments, each over its own inner control point.

    .. math:: B[q_i, M_i, q_{i+1}](t), \qquad
              M_{i+1} = G[M_i, q_{i+1}](1 + h_{i+1}/h_i)

    Nielson (1993), eqs. 18 to 21, for equal intervals, where the factor is 2.  The first inner
    control point determines the whole curve.  By default a search finds it by

    * criterion 20, least length of the polygon :math:`q_1, M_1, M_2, \ldots, q_n`, or
    * criterion 21, least sum of squared distances of the segments' middles from their inner points,

    with geodesic distances.  As printed, both criteria minimise inner products, which drives the
    points apart: the integral of squared acceleration is then 15 and 46 times as large.  Also, (19)
    runs to *n* and (20) sums to *n - 1*, each one too far.  Both criteria have several local
    minima.  The search takes the best one from a fixed set of starts.  Its time is proportional to
    the number of keyframes, some 4 ms each.

    The velocity is continuous at the keyframes.  If an extrapolated arc is longer than pi it
    wraps around the sphere and the velocity jumps; :attr:`continuity` is then 0.

    Picture: ``orientd plot spherical_quadratic``.

    Args:
        M1: the first inner control point, a unit quaternion; *align* chooses the sign nearer to the
            first keyframes.
        criterion: 20 or 21, for the search.
    """

    name = "spherical_quadratic"
    summary = "quadratic slerp segments through inner control points"
    source = "Nielson 1993, eqs. 18 to 21"
    own: ClassVar[Mapping[str, Any]] = {"M1": None, "criterion": 21}

    def _solve(
        self,
        q: Floats,
        instants: Floats,
        *,
        M1: ArrayLike | None,  # noqa: N803 - the paper's name, in every motion file
        criterion: int,
    ) -> None:
        check_criterion(criterion, (20, 21))
        h = np.diff(instants)
        ratios = h[1:] / h[:-1]
        if M1 is None:
            first = best_first_point(q, ratios, criterion)
        else:
            first = check_quaternion(M1, "M1")
            if self._aligns and float(first @ (q[0] + q[1])) < 0.0:
                first = -first
        inner = inner_points(first[None], q, ratios)[0]
        arcs = ratios * _lengths(log_half(between(inner[:-1], q[1:-1])))
        continuity = 2 if len(q) == 2 else int(arcs.max() < np.pi)
        self._set_triangles(instants, np.stack([q[:-1], inner, q[1:]], axis=1), continuity)

    @property
    def shoulders(self) -> Floats:
        """Inner control points, shape ``(n - 1, 4)``."""
        points: Floats = self._points[:, 1].copy()
        return points


def check_criterion(criterion: object, allowed: tuple[int, int]) -> None:
    """Refuse a criterion that is not one of two equation numbers."""
    if isinstance(criterion, bool) or criterion not in allowed:
        raise ParameterError(
            "criterion", f"criterion must be {allowed[0]} or {allowed[1]}, got {criterion!r}"
        )


def check_chords(q: Floats) -> Floats:
    """Return the distances between neighbouring keyframes; refuse a circle without a plane."""
    chords = _lengths(q[1:] - q[:-1])
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
    """Return a basis of the first tangent space and its mirror images at the other keyframes."""
    carried = [frame_of(q)[:, 1:]]
    for normal in (q[1:-1] - q[:-2]) / chords[:-1, None]:
        carried.append(2.0 * np.outer(normal, normal @ carried[-1]) - carried[-1])
    return np.array(carried)


def projected_tangent(point: Floats, q: Floats) -> Floats:
    """Return the tangent at the first keyframe towards an inner control point, adjusted to fit.

    The point is projected on the plane of points whose products with both keyframes are one.  A
    point given for the negated quaternions is negated.
    """
    half_sum, half_difference = 0.5 * (q[0] + q[1]), 0.5 * (q[1] - q[0])
    if float(point @ half_sum) < 0.0:
        point = -point
    for direction in (half_sum, half_difference):
        point = point - float(point @ direction) / float(direction @ direction) * direction
    tangent: Floats = point + half_sum / float(half_sum @ half_sum) - q[0]
    return tangent


def speed_ratios(speeds: Floats, a1: float | str) -> Floats:
    """Return the ratios of eq. 15 that make the speed continuous, from chord over interval."""
    signs = (-1.0) ** np.arange(len(speeds))
    logs: Floats = np.zeros(len(speeds))
    logs[1:] = signs[1:] * np.cumsum(signs[1:] * np.diff(np.log(speeds)))
    if isinstance(a1, str) and a1 == "balanced":
        shift = -float(np.mean(signs * logs))
    else:
        first = check_number(a1, "a1")
        if first <= 0.0:
            raise ParameterError("a1", f"a1 must be a positive number or 'balanced', got {a1!r}")
        shift = float(np.log(first))
    ratios: Floats = np.exp(logs + signs * shift)
    return ratios


def frame_of(q: Floats) -> Floats:
    """Return an orthonormal frame of four dimensions that turns with the keyframes, as columns.

    Its first vector is the first keyframe, the second points to the second one, and the third
    depends on the following ones.  So a search in this frame has the same result in any coordinate
    system. Its determinant is positive.
    """
    rows = np.zeros((0, 4))
    for candidate in (*q, *np.eye(4)):
        rest = candidate - (rows @ candidate) @ rows
        length = np.linalg.norm(rest)
        if length > 1e-6 and len(rows) < 3:
            rest = rest / length
            rest = rest - (rows @ rest) @ rows
            rows = np.vstack([rows, rest / np.linalg.norm(rest)])
    frame = np.vstack([rows, np.linalg.svd(rows)[2][3]])
    frame[3] *= np.sign(np.linalg.det(frame))
    return frame.T


def best_direction(
    pulls: Floats, chords: Floats, criterion: int, *, is_restricted: bool
) -> Floats | None:
    r"""Return the first tangent with the least criterion found (Nielson, 1993, criteria 13 and 14).

    Every tangent length of a circle spline follows from the first tangent *T*:
    :math:`\tau_i = \tfrac12 d_i / (p_i \cdot T)` with fixed vectors :math:`p_i`.  So a criterion is
    a sum over segments of functions of :math:`\tau_i`:

    * 13, the length of the polygon of inner control points,
      :math:`|\tau_1| + \sum |\tau_i + \tau_{i+1}| + |\tau_n|`.  Without a negative weight it has
      one minimum, as :math:`\tfrac12 \|x\|^2 + \sum d_i / (p_i \cdot x)` is strictly convex.
      Otherwise it has corners at :math:`\tau_i = -\tau_{i+1}`, a great circle for each *i*.
    * 14, the squared distances of the arcs' middles from their inner control points,
      :math:`\sum \tau_i^2 (\tau_i - k_i)/(\tau_i + k_i)`, :math:`k_i = \tfrac12 d_i`.  It may have
      several minima.

    A state of the search is a tangent and the normal of the circle that it is confined to, or zero.

    Args:
        pulls: the vectors *p*, in the basis of the first tangent space, shape ``(n, 3)``.
        chords: distances *d* between neighbouring keyframes, shape ``(n,)``.
        criterion: 13 or 14.
        is_restricted: whether all weights must be positive; the result is ``None`` if that is
            impossible.
    """
    halves = 0.5 * chords

    def values(state: Floats) -> Floats:
        weights = state[:, :3] @ pulls.T
        is_allowed = np.all(weights > 0.0 if is_restricted else weights != 0.0, axis=1)
        is_allowed &= weights[:, 0] > 0.0
        safe = np.where(is_allowed[:, None], weights, 1.0)
        total: Floats = np.sum(_terms(halves / safe, halves, criterion)[0], axis=1)
        return np.where(is_allowed, total, np.inf)

    def derivatives(state: Floats) -> tuple[Floats, Floats]:
        basis = _directions(state)
        weights = (state[:, :3] @ pulls.T)[..., None]
        lengths = halves[:, None] / weights
        across = (pulls @ basis) / weights
        _, first, second = _terms(lengths[..., 0], halves, criterion)
        slope = first[..., None] * lengths
        bend = second[..., None] * lengths * lengths + 2.0 * slope
        hessian = np.swapaxes(across, 1, 2) @ (bend * across)
        hessian += np.sum(slope, axis=1)[..., None] * np.eye(2)
        return -np.sum(slope * across, axis=1), hessian

    def move(state: Floats, step: Floats) -> Floats:
        moved = _unit(state[:, :3] + (_directions(state) @ step[..., None])[..., 0])
        return np.concatenate([moved, state[:, 3:]], axis=1)

    # Directions spread evenly over the half sphere around the first axis.
    height = (np.arange(GRID) + 0.5) / GRID
    turn, radius = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(GRID), np.sqrt(1.0 - height * height)
    starts = np.stack([height, radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    if is_restricted and not np.isfinite(values(starts)).any():
        center = _inside_cone(pulls)
        if center is None:
            return None
        starts = center[None]
    has_kinks = not is_restricted and criterion == 13 and len(pulls) > 1
    # One start is enough for the only minimum.
    count = 1 if is_restricted and criterion == 13 else STARTS
    searches = [(np.pad(starts, ((0, 0), (0, 3))), count)]
    if has_kinks:
        normals = _unit(halves[:-1, None] * pulls[1:] + halves[1:, None] * pulls[:-1])[:KINKS]
        searches.append((_on_kinks(normals), STARTS))
    found = [
        multistart(
            values,
            derivatives,
            some,
            move=move,
            count=many,
            iterations=16 if has_kinks else 40,
        )
        for some, many in searches
    ]
    best: Floats = min(found, key=lambda one: one[1])[0][:3]
    return best


def _on_kinks(normals: Floats) -> Floats:
    """Return states all around the great circles with these normals, and at their intersections."""
    angles = 2.0 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    sides = _directions(np.pad(normals, ((0, 0), (0, 3))))
    around = np.swapaxes(sides @ np.stack([np.cos(angles), np.sin(angles)]), 1, 2)
    i, j = np.triu_indices(len(normals), 1)
    corners = _unit(cross(normals[i], normals[j]))
    tangents = np.concatenate([around.reshape(-1, 3), corners, -corners])
    return np.hstack(
        [tangents, np.concatenate([normals.repeat(AROUND, 0), normals[i], normals[i]])]
    )


def _directions(state: Floats) -> Floats:
    """Return two directions in which each tangent may move, as columns, ``(s, 3, 2)``.

    A tangent confined to a circle has only one; the other is zero.
    """
    x, normal = state[:, :3], state[:, 3:]
    is_free = ~normal.any(axis=1, keepdims=True)
    side = cross(x, np.where(is_free, np.eye(3)[np.argmin(np.abs(x), axis=1)], -normal))
    side = _unit(side)
    return np.stack([side, np.where(is_free, cross(x, side), 0.0)], axis=2)


def _unit(vectors: Floats) -> Floats:
    """Return normalised vectors; zero vectors are unchanged."""
    lengths = _lengths(vectors)[..., None]
    unit: Floats = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _terms(lengths: Floats, halves: Floats, criterion: int) -> tuple[Floats, Floats, Floats]:
    """Return the contribution of each tangent length to a criterion, with two derivatives."""
    if criterion == 13:
        joints = np.sign(lengths[..., :-1] + lengths[..., 1:])
        slopes = np.sign(lengths)
        slopes[..., 1:] = joints
        slopes[..., :-1] += joints
        slopes[..., -1] += np.sign(lengths[..., -1])
        return slopes * lengths, slopes, np.zeros_like(slopes)
    total = lengths + halves
    # t^2 (t - k)/(t + k) = t^2 - 2 k t + 2 k^2 - 2 k^3/(t + k)
    return (
        lengths * lengths * (lengths - halves) / total,
        2.0 * lengths - 2.0 * halves + 2.0 * halves**3 / total**2,
        2.0 - 4.0 * halves**3 / total**3,
    )


def _inside_cone(pulls: Floats) -> Floats | None:
    """Return a unit vector well inside the cone of positive weights, if there is one.

    It points to the point of the convex hull of the unit pulls that is nearest to the origin, by
    the algorithm of Wolfe (1976), which ends as soon as every weight is at least half the best.
    """
    unit = _unit(pulls)
    corners, shares = unit[:1], np.ones(1)
    for _ in range(ROUNDS):
        nearest = shares @ corners
        along = unit @ nearest
        if nearest @ nearest < 1e-18:
            return None
        if along.min() > 0.5 * (nearest @ nearest):
            return _unit(nearest)
        corners = np.concatenate([corners, unit[[np.argmin(along)]]])
        shares = np.append(shares, 0.0)
        while True:
            # The nearest point of the whole flat through the corners, as far as it is in the hull.
            rest = np.linalg.lstsq((corners[1:] - corners[0]).T, -corners[0], rcond=None)[0]
            ahead = np.concatenate([[1.0 - rest.sum()], rest])
            if ahead.min() > 0.0:
                shares = ahead
                break
            out = ahead <= 0.0
            step = np.min(shares[out] / np.maximum(shares[out] - ahead[out], 1e-300))
            shares = shares + step * (ahead - shares)
            is_kept = shares > 1e-12
            corners, shares = corners[is_kept], shares[is_kept] / shares[is_kept].sum()
    return None


def best_first_point(q: Floats, ratios: Floats, criterion: int) -> Floats:
    """Return the first inner control point with the least criterion found (eqs. 20 and 21)."""

    def values(first: Floats) -> Floats:
        return criterion_values(first, q, ratios, criterion)

    def move(x: Floats, step: Floats) -> Floats:
        return normalize(multiply(x, exp_half(step)))

    # Candidates all over the sphere, and more of them near the first two keyframes.
    generator = np.random.default_rng(20)
    frame = frame_of(q)
    count = max(64, min(SCREENED, WORK // len(q)))
    everywhere = generator.normal(size=(count, 4)) @ frame.T
    middle = q[0] + q[1]
    middle = middle / np.linalg.norm(middle) if np.any(np.abs(middle) > 1e-9) else frame[:, 1]
    spread = generator.uniform(0.0, 1.5, (count, 1)) * generator.normal(size=(count, 4))
    starts = normalize(np.concatenate([middle[None], middle + spread @ frame.T, everywhere]))
    if criterion == 20:
        starts = np.concatenate([starts, _kinks(q, ratios)])
    count = max(2, min(STARTS, LONGEST // len(q)))
    return multistart(values, differences(values, move, 3), starts, move=move, count=count)[0]


def inner_points(first: Floats, q: Floats, ratios: Floats) -> Floats:
    """Return all inner control points, ``(s, n - 1, 4)``, for candidates of the first, ``(s, 4)``.

    *ratios* are each interval over the previous one, shape ``(n - 2,)``.
    """
    points: Floats = np.empty((len(first), len(q) - 1, 4))
    points[:, 0] = m = first
    for i, (key, ratio) in enumerate(zip(q[1:-1], ratios, strict=True), 1):
        # slerp(m, key, 1 + ratio), written out: this is the inner loop of the search.
        angle = 2.0 * np.arctan2(_lengths(m - key), _lengths(m + key))
        sine = np.where(angle > 0.0, np.sin(angle), 1.0)
        back = np.where(angle > 0.0, -np.sin(ratio * angle) / sine, -ratio)
        ahead = np.where(angle > 0.0, np.sin((1.0 + ratio) * angle) / sine, 1.0 + ratio)
        m = back[:, None] * m + ahead[:, None] * key
        points[:, i] = m = m / _lengths(m)[:, None]
    return points


def criterion_values(first: Floats, q: Floats, ratios: Floats, criterion: int) -> Floats:
    """Return criterion 20 or 21 for candidates of the first inner point, shape ``(s,)``."""
    points = inner_points(first, q, ratios)
    if criterion == 20:
        ends = np.broadcast_to(q[[0, -1]], (len(points), 2, 4))
        nodes = np.concatenate([ends[:, :1], points, ends[:, 1:]], axis=1)
        terms = _lengths(log_half(between(nodes[:, :-1], nodes[:, 1:])))
    else:
        # Seen from the inner point M, the keyframes are exp(a) and exp(b), and the middle lies
        # towards exp(a/2) + exp(b/2).
        seen = multiply(conjugate(points)[:, None], np.stack([q[:-1], q[1:]]))
        terms = _lengths(log_half(np.sum(exp_half(0.5 * log_half(seen)), axis=1))) ** 2
    total: Floats = np.sum(terms, axis=1)
    return total


def _lengths(vectors: Floats) -> Floats:
    lengths: Floats = np.sqrt(np.sum(vectors * vectors, axis=-1))
    return lengths


def _kinks(q: Floats, ratios: Floats) -> Floats:
    """Return the candidates whose chain puts an inner point on a keyframe.

    There the length of the polygon has a corner, where a descent does not converge.
    """
    found = []
    for place in range(1, min(len(q) - 1, KINKS)):
        point = q[place]
        for i in range(place - 2, -1, -1):
            point = slerp(q[i + 1], point, -1.0 / ratios[i])
        found.append(point)
    return np.array(found).reshape(-1, 4)
