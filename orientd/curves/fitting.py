r"""Fit a spline to measured orientations with noise, gaps, outliers and uneven times.

The curve is the C2 cumulative cubic B-spline of Kim, Kim and Shin (1995), sec. 5.3, which
approximates the samples.  It has as many knots as an error bound requires.  The bound applies to
the angle between the curve and the *filtered* samples: residuals averaged over enough neighbours to
suppress the noise. A single sample may be further away by its own noise.

The true rotation is unknown, so there is no guarantee about it.  In a test, forty recordings with
half a degree of noise were fitted within one degree.  Every curve was within one degree of the true
rotation, except around half a second without samples: there the error was at most 1.4 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.basis import Indices, cumulative_basis
from orientd.curves.newton import solve_blocks
from orientd.curves.products import KksBspline
from orientd.errors import PlanError
from orientd.rotation import Floats, align, angle, conjugate, exp, log, multiply, rotate, slerp

FEWEST = 8
"""Fewest samples of a fit."""

_NORMS = (0.5, 2.0)
_WILD = 6.0
"""Standard deviations of the noise beyond which a sample is an outlier."""

_MOST_WILD = 0.1
"""Share of outliers beyond which no spline is fitted."""

_LEAST_WILD = 2e-3
"""Rad; a sample closer than this to its neighbours is no outlier, however small the noise is."""

_BRIEF, _LONG = 0.1, 2.0
"""Steps of time below and above so many mean ones are those of bursts ..."""

_MANY, _SOME = 0.2, 0.05
"""... if at least these shares of all steps are.  Random times have half as many brief ones."""

_BEYOND_NOISE = 10.0
"""A fit that is further off than this many standard deviations is so for another reason."""

_PASSES = 20
_GAUSSIAN = 1.4826  # standard deviations in a median of absolute deviations

ORDER = 4
DEFAULT_TOLERANCE = math.radians(1.0)

_NOISE_SHARE = 0.3
"""Share of the bound for filtered noise."""

_MOST_AVERAGED = 15
"""Most neighbours in the filter, so that it does not smooth the motion."""

_TARGET = 0.65
"""Share of the bound up to which few knots are enough: the rest is for noise."""

_LONGEST_STEP = 1.0
"""Largest angle between two control quaternions, rad: well below the cut of the logarithm."""

_FEWEST = 4
"""Fewest samples in a span that may be divided."""

_SMOOTHING, _RIDGE = 1e-7, 1e-9
"""Relative weights of squared second differences, and of undetermined directions."""
_ITERATIONS = 12
_ROUNDS = 24


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Samples of an orientation.

    Attributes:
        times: increasing, s, shape ``(n,)``.
        q: unit quaternions with aligned signs, shape ``(n, 4)``.
        noise: standard deviation of the noise about each axis, rad.
        left_out: number of missing, repeated and outlying samples.
    """

    times: Floats
    q: Floats
    noise: float
    left_out: int


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted spline.

    Attributes:
        control: control quaternions, shape ``(m, 4)``.
        knots: fourfold at both ends, s, shape ``(m + 4,)``.
        samples: the fitted samples, in order.
        errors: angles between the curve and the filtered samples, rad.
        averaged: number of samples that the filter averages.
    """

    control: Floats
    knots: Floats
    samples: Measured
    errors: Floats
    averaged: int

    @property
    def curve(self) -> KksBspline:
        """The spline."""
        return KksBspline(control=self.control, knots=self.knots)

    @property
    def error(self) -> float:
        """The largest angle between the curve and the filtered samples, rad."""
        return float(self.errors.max())

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return float(self.knots[-1] - self.knots[0])

    @property
    def knot_count(self) -> int:
        """Number of distinct knots."""
        return len(np.unique(self.knots))

    @property
    def times(self) -> Floats:
        """Times of the control quaternions: averages of their knots, s."""
        window = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], ORDER - 1)
        times: Floats = np.mean(window, axis=1)
        times[0], times[-1] = self.knots[0], self.knots[-1]
        return times


def fit_orientations(
    times: ArrayLike, q: ArrayLike, *, tolerance: float = DEFAULT_TOLERANCE
) -> Fit:
    """Return a spline that stays near measured orientations, with knots where they are needed.

    Args:
        times: of the samples, s, shape ``(n,)``; in any order, with gaps.
        q: orientations ``(w, x, y, z)`` of either sign, shape ``(n, 4)``.  Samples that are not
            finite, not nearly of unit norm, or far from their neighbours count as missing.
        tolerance: largest angle between curve and filtered samples, rad.

    Raises:
        ValueError: the tolerance is not positive, or the shapes do not match.
        PlanError: there are too few samples, or their noise does not allow the bound.
    """
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance must be positive, got {tolerance}")
    samples = clean(times, q)
    wanted = math.ceil(3.0 * (samples.noise / (_NOISE_SHARE * tolerance)) ** 2)
    averaged = min(max(1, wanted), _MOST_AVERAGED) | 1
    work = _Fitter(samples, averaged, _TARGET * tolerance)
    fitted = work.trimmed(work.grown())
    if fitted.error > tolerance:
        raise PlanError(
            f"no spline stays within {math.degrees(tolerance):.3g} deg of the samples: "
            f"{describe_bursts(times) or _describe_worst(fitted)}"
        )
    return fitted


def describe_bursts(times: ArrayLike) -> str:
    """Return why times, in any order, look like times of arrival; an empty text if they do not.

    Samples that waited for each other arrive in bursts: many steps are far shorter than the mean,
    and some are far longer.
    """
    instants = np.asarray(times, dtype=np.float64)
    instants = np.unique(instants[np.isfinite(instants)])
    if len(instants) < FEWEST:
        return ""
    steps = np.diff(instants)
    brief, long = _BRIEF * steps.mean(), _LONG * steps.mean()
    many, some = int(np.sum(steps < brief)), int(np.sum(steps > long))
    if many < _MANY * len(steps) or some < _SOME * len(steps):
        return ""
    return (
        "the times look like times of arrival, not of measurement: of "
        f"{len(steps)} steps {many} are below {1e3 * brief:.2g} ms and {some} above "
        f"{1e3 * long:.2g} ms; use times of measurement"
    )


def _describe_worst(fit: Fit) -> str:
    """Return why a fit is far from its samples, and the bound that it meets."""
    allow = f"allow {math.degrees(1.1 * fit.error):.2g} deg"
    if fit.error < _BEYOND_NOISE * fit.samples.noise:
        return f"their noise is {math.degrees(fit.samples.noise):.2g} deg per axis; {allow}"
    times, turns = fit.samples.times, angle(fit.samples.q[1:], fit.samples.q[:-1])
    quickest = int(np.argmax(turns / np.diff(times)))
    return (
        f"they jump by {math.degrees(turns[quickest]):.3g} deg within "
        f"{times[quickest + 1] - times[quickest]:.3g} s at {times[quickest]:.3f} s; cut the "
        f"recording there, or {allow}"
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Fitter:
    """One call of :func:`fit_orientations`.

    Attributes:
        samples: the samples to fit.
        averaged: number of neighbours over which residuals are averaged.
        target: largest averaged residual, rad.
    """

    samples: Measured
    averaged: int
    target: float

    def grown(self) -> Fit:
        """Return a fit that meets the target as far as there are samples for its knots."""
        times = self.samples.times
        count = max(1, math.ceil(self._travel() / _LONGEST_STEP))
        # At first, all spans have equally many samples.
        breaks = np.quantile(times, np.linspace(0.0, 1.0, count + 1))
        breaks = np.unique(breaks)
        fitted = self.fitted(breaks)
        for _ in range(_ROUNDS):
            breaks = _breaks(fitted)
            span = np.clip(np.searchsorted(breaks, times, side="right") - 1, 0, len(breaks) - 2)
            worst = np.zeros(len(breaks) - 1)
            np.maximum.at(worst, span, fitted.errors)
            steps = angle(fitted.control[1:], fitted.control[:-1])
            # A step of the control polygon affects the three spans around it.
            longest = np.max(np.stack([steps[:-2], steps[1:-1], steps[2:]]), axis=0)
            held = np.bincount(span, minlength=len(worst))
            is_cut = ((worst > self.target) | (longest > 1.5 * _LONGEST_STEP)) & (held >= _FEWEST)
            if not is_cut.any():
                break
            cuts = [float(np.median(times[span == k])) for k in np.flatnonzero(is_cut)]
            finer = np.unique(np.concatenate([breaks, cuts]))
            if len(finer) == len(breaks):
                break
            fitted = self.fitted(finer, fitted)
        return fitted

    def trimmed(self, fitted: Fit) -> Fit:
        """Return the same curve without its ends, where noise dominates a fit.

        The cut at each side has as many samples as the filter averages.  The curve over fewer knots
        is fitted to this one, and differs from it only by the curvature of the group.
        """
        times, breaks = self.samples.times, _breaks(fitted)
        cut = self.averaged
        if cut < 2 or 8 * cut >= len(times):
            return fitted
        begin, end = times[cut], times[-1 - cut]
        inner = breaks[(breaks > begin) & (breaks < end)]
        shorter = np.concatenate([[begin], inner, [end]])
        # Four times in the shortest span, or its control quaternions would be undetermined.
        marks = (shorter[:-1, None] + np.diff(shorter)[:, None] * np.linspace(0, 1, 9)).ravel()
        instants = np.unique(np.concatenate([times[cut : len(times) - cut], marks]))
        q = fitted.curve.evaluate(instants)[0]
        exact = replace(self.samples, times=instants, q=q)
        copy = _Fitter(exact, 1, self.target).fitted(shorter)
        kept = replace(self.samples, times=times[cut:-cut], q=self.samples.q[cut:-cut])
        there = np.searchsorted(instants, kept.times)
        copied = copy.curve.evaluate(kept.times)[0]
        away = rotate(conjugate(copied), log(multiply(kept.q, conjugate(copied))))
        errors = np.sqrt(np.sum(averages(away, self.averaged) ** 2, axis=-1))
        errors = np.maximum(errors, copy.errors[there])
        return replace(copy, samples=kept, errors=errors, averaged=self.averaged)

    def fitted(self, breaks: Floats, before: Fit | None = None) -> Fit:
        r"""Return the spline over *breaks* nearest to the samples, by least squares of angles.

        Turning every control quaternion *j* by a small :math:`\delta_j` in the world frame turns
        the curve by :math:`\sum_j B_j(t)\, \delta_j`, apart from the curvature of the group.  So
        the iteration repeats a linear fit.
        """
        times, q = self.samples.times, self.samples.q
        knots = np.concatenate([np.repeat(breaks[0], 3), breaks, np.repeat(breaks[-1], 3)])
        fit = Fit(np.empty((len(breaks) + 2, 4)), knots, self.samples, np.empty(0), self.averaged)
        control = self._guess(fit.times, before)
        count = len(control)
        first, weights = _weights(knots, times)
        steps = np.arange(ORDER)
        scale = float(np.bincount((first[:, None] + steps).ravel(), weights.ravel() ** 2).max())
        # Below the samples, a row for each second difference and for each control quaternion.
        smooth = math.sqrt(_SMOOTHING * scale)
        bends = np.tile(smooth * np.array([1.0, -2.0, 1.0, 0.0]), (count - 2, 1))
        ridge = np.tile(math.sqrt(_RIDGE * scale) * np.eye(ORDER)[0], (count, 1))
        design = np.concatenate([weights, bends, ridge])
        first = np.concatenate([first, np.arange(count - 2), np.arange(count)])
        normal = design[:, :, None] * design[:, None, :]
        residuals = self._residuals(control, knots)
        for _ in range(_ITERATIONS):
            turns = log(multiply(control[1:], conjugate(control[:-1])))
            short = [residuals, -smooth * np.diff(turns, axis=0), np.zeros((count, 3))]
            shares = design[..., None] * np.concatenate(short)[:, None]
            right = np.zeros((count + ORDER, 3))
            np.add.at(right, first[:, None] + steps, shares)
            delta = solve_blocks(normal, first, first, right[:count])
            control = multiply(exp(delta), control)
            residuals = self._residuals(control, knots)
            if float(np.abs(delta).max()) < 1e-3 * self.target:
                break
        control = align(control)
        body = rotate(conjugate(q), residuals)
        errors = np.sqrt(np.sum(averages(body, self.averaged) ** 2, axis=-1))
        return replace(fit, control=control, errors=errors)

    def _guess(self, times: Floats, before: Fit | None) -> Floats:
        """Return orientations at *times*, from an existing fit or from samples."""
        if before is not None:
            return before.curve.evaluate(times)[0]
        known = self.samples.times
        place = np.clip(np.searchsorted(known, times, side="right") - 1, 0, len(known) - 2)
        share = (times - known[place]) / (known[place + 1] - known[place])
        q = self.samples.q
        return slerp(q[place], q[place + 1], np.clip(share, 0.0, 1.0))

    def _residuals(self, control: Floats, knots: Floats) -> Floats:
        """Return the turns from the curve to the samples, world frame, rad."""
        q = KksBspline(control=control, knots=knots).evaluate(self.samples.times)[0]
        return log(multiply(self.samples.q, conjugate(q)))

    def _travel(self) -> float:
        """Return the approximate total turn of the samples, without their noise, rad."""
        q = self.samples.q[:: max(1, self.averaged)]
        return float(np.sum(angle(q[1:], q[:-1])))


def _weights(knots: Floats, times: Floats) -> tuple[Indices, Floats]:
    """Return the first B-spline that counts at each of *times*, and the values of all four."""
    basis = cumulative_basis(knots, ORDER)
    span = np.clip(np.searchsorted(basis.breaks, times, side="right") - 1, 0, len(basis.breaks) - 2)
    sums = np.vstack([np.ones(len(times)), basis.at(span, times)[0], np.zeros(len(times))])
    return basis.first[span] - 1, (sums[:-1] - sums[1:]).T


def averages(vectors: Floats, count: int) -> Floats:
    """Return the mean of each vector and its neighbours, *count* in all, fewer at the ends."""
    half = count // 2
    sums = np.concatenate([np.zeros((1, vectors.shape[1])), np.cumsum(vectors, axis=0)])
    place = np.arange(len(vectors))
    # As many on one side as on the other, or a slope would look like an offset.
    reach = np.minimum(np.minimum(place, len(vectors) - 1 - place), half)
    first, last = place - reach, place + reach + 1
    means: Floats = (sums[last] - sums[first]) / (last - first)[:, None]
    # The outermost samples have neighbours on one side only, so their noise cannot be averaged.
    edge = min(half, (len(vectors) - 1) // 2)
    means[:edge], means[len(vectors) - edge :] = means[edge], means[len(vectors) - 1 - edge]
    return means


def _breaks(fit: Fit) -> Floats:
    return fit.knots[ORDER - 1 : 1 - ORDER]


def clean(times: ArrayLike, q: ArrayLike) -> Measured:
    """Return samples in order, without missing, repeated and outlying ones.

    Each sample is compared with the cubic through two neighbours on either side.  An outlier is
    further from it than the noise of all samples explains.

    Args:
        times: s, shape ``(n,)``, in any order.
        q: orientations ``(w, x, y, z)`` of either sign, shape ``(n, 4)``.

    Raises:
        ValueError: the shapes are wrong.
        PlanError: fewer than :data:`FEWEST` samples are left, or more than a tenth are outliers.
    """
    instants, found = np.asarray(times, dtype=np.float64), np.asarray(q, dtype=np.float64)
    if instants.ndim != 1 or found.shape != (len(instants), 4):
        raise ValueError(
            f"times and q must have shapes (n,) and (n, 4), got {instants.shape} and {found.shape}"
        )
    given = len(instants)
    with np.errstate(over="ignore"):  # samples out of range are left out
        norms = np.sqrt(np.sum(found * found, axis=-1))
    is_there = np.isfinite(instants) & (norms > _NORMS[0]) & (norms < _NORMS[1])
    instants, found = instants[is_there], found[is_there] / norms[is_there, None]
    instants, order = np.unique(instants, return_index=True)
    found = found[order]
    all_instants = instants
    noise = 0.0
    for _ in range(_PASSES):
        if len(instants) < FEWEST:
            problem = f"a fit needs at least {FEWEST} samples, got {len(instants)}"
            if given < FEWEST:
                raise PlanError(f"{problem}; take a longer recording")
            raise PlanError(
                f"{problem} on one smooth motion of {given}; check the columns of the quaternions, "
                "and the unit of the times"
            )
        misses, spread = _misses(instants, found)
        noise = _GAUSSIAN * float(np.median(np.abs(misses / spread[:, None])))
        size = np.sqrt(np.sum(misses**2, axis=-1))
        excess = size / np.maximum(_WILD * noise * spread, _LEAST_WILD)
        # The neighbours of an outlier miss their cubics too, but by less.
        around = np.lib.stride_tricks.sliding_window_view(np.pad(excess, 2), 5).max(axis=1)
        is_wild = (excess > 1.0) & (excess >= around)
        if not is_wild.any():
            break
        keep = np.ones(len(instants), dtype=bool)
        keep[2:-2] = ~is_wild
        # The two outermost samples have no cubic of their own.  An outlier among them looks the
        # same as one next to them, and keeping them would remove the next ones one by one.
        keep[:2] &= not is_wild[0]
        keep[-2:] &= not is_wild[-1]
        instants, found = instants[keep], found[keep]
    wild = np.setdiff1d(all_instants, instants)
    if len(wild) > _MOST_WILD * len(all_instants):
        raise PlanError(
            f"{len(wild)} of {len(all_instants)} samples are outliers, expected at most a tenth: "
            f"{describe_bursts(all_instants) or _describe_first(wild)}"
        )
    return Measured(instants, align(found), noise, given - len(instants))


def _describe_first(wild: Floats) -> str:
    return (
        f"the first at {wild[0]:.3f} s; look at the samples there, and at the order of w, x, y, z"
    )


def _misses(times: Floats, q: Floats) -> tuple[Floats, Floats]:
    """Return the deviation of samples from the cubic through two neighbours on either side.

    Returns:
        Turns in rad, shape ``(n - 4, 3)``, and the noise amplification of each, ``(n - 4,)``.
    """
    count = len(times) - 4
    here = slice(2, 2 + count)
    places = (0, 1, 3, 4)
    nodes = np.stack([times[k : k + count] for k in places]) - times[here]
    miss: Floats = np.zeros((count, 3))
    squares = np.ones(count)
    for k, place in enumerate(places):
        others = [j for j in range(4) if j != k]
        weight = np.prod([nodes[j] / (nodes[j] - nodes[k]) for j in others], axis=0)
        turn = log(multiply(conjugate(q[here]), q[place : place + count]))
        miss += weight[:, None] * turn
        squares += weight**2
    return miss, np.sqrt(squares)
