"""The quickest timing of a keyframe path: along itself as fast as its limits permit.

The limits are Bobrow's, of velocity, acceleration and jerk of a motion along a given path (Bobrow,
Dubowsky and Gibson 1985; Pham and Pham 2018 for what is usual today), here as norms and components
of vectors of the rotation group, where omega and alpha are as linear in the derivatives of the
parameter as on any other path.  :mod:`orientd.planner.timing.profile` solves for the speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from orientd.curves import Retimed, TimeMap, unit_map
from orientd.errors import PlanError
from orientd.planner import refusal
from orientd.planner.limits import ANGULAR, Limits
from orientd.planner.path import PathSegment, motion_of, repositioned
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.profile import Bound, End, Profile, ProfileError, fastest_profile
from orientd.planner.timing.rates import LimitedRate
from orientd.planner.timing.timing import Indices
from orientd.rotation import Floats

SHARE = 0.999
"""Of acceleration and jerk that the quickest timing uses; the rest lets it be stopped at all."""

_REST = 1e-9  # of the largest angular velocity of the keyframe path
_FEWEST_STEPS = 400
_STEPS_A_SEGMENT = 16, 24  # at the least and at the most, where there are many
_MOST_STEPS = 1200  # where there are few
_RAMP_STEPS = 4.0  # in the time that the acceleration needs to rise, between these bounds
_FASTEST = 1e6  # times as fast as the keyframe path, where nothing limits it
_ATTEMPTS = 8
_ASIDE = 5  # quarters of a step from a knot to where the jerk is that of one side alone
_EASED = 0.99  # share of a limit that what is given at an end counts for at most
_PATIENCE = 1  # attempts after which to aim lower everywhere
_WHOLE = 1e-9  # of a period
_GAUSS = np.polynomial.legendre.leggauss(4)


def quickest(
    keyframe_path: KeyframePath, limits: Limits, period: float, *, share: float = SHARE
) -> KeyframePath:
    """Return the same path in the shortest time that keeps the limits.

    An end at rest stays at rest and gets no acceleration; at an end that moves, velocity and
    acceleration stay what they are.

    Args:
        keyframe path: with continuous acceleration.
        limits: to keep, as seen on records a *period* apart.
        period: of the device, s.
        share: of the limits of acceleration and jerk to use.

    Raises:
        PlanError: none was found.
    """
    problem = _Problem.of(keyframe_path, limits.with_reserve(share), period)
    rates = problem.rates()
    for attempt in range(_ATTEMPTS):
        profile = problem.solved(rates)
        quick = problem.retimed(profile)
        refusal.check_duration(quick.duration)
        # Where a lead goes on, the last record that is the keyframe path's own.
        last = math.floor(quick.duration / period + _WHOLE) if problem.is_moving[1] else None
        peaks = quick.peaks(period, limits, last=last)
        excess = {
            "velocity": peaks.spins,
            "acceleration": peaks.bends,
            "jerk": peaks.twists,
            "linear_velocity": peaks.linear_velocity.ratio,
            "linear_acceleration": peaks.linear_acceleration.ratio,
        }
        if max(excess.values()) <= 1.0:
            return quick
        # Where a limit is exceeded between the places that were looked at, by a little, aim lower.
        patient = attempt < _PATIENCE
        rates = [
            rate.aiming_lower(profile, 1.0 if patient else excess[rate.name]) for rate in rates
        ]
    raise PlanError(f"no quickest timing keeps the limits, by a factor of {max(excess.values()):g}")


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """A keyframe path with a parameter from 0 to 1 that starts and ends like a motion.

    Attributes:
        keyframe path: the path.
        limits: to keep.
        powers: how the keyframe path's time starts and ends by the parameter.
        is_moving: whether the keyframe path moves at its start and at its end.
        count: of steps between nodes.
    """

    keyframe_path: KeyframePath
    limits: Limits
    powers: tuple[float, float]
    is_moving: tuple[bool, bool]
    count: int

    @classmethod
    def of(cls, keyframe_path: KeyframePath, limits: Limits, period: float) -> _Problem:
        first, last = keyframe_path.segment.ends()
        _, omega, _ = keyframe_path.segment.sample(np.linspace(0.0, keyframe_path.duration, 65))
        rest = _REST * float(np.linalg.norm(omega, axis=1).max())
        is_moving = tuple(bool(np.linalg.norm(end.omega_body) > rest) for end in (first, last))
        # Where the path sets out with an acceleration, its angle grows like the square of its
        # time, and that of a motion from rest like the cube: like the square without jerk limit.
        jerks = math.isfinite(limits.jerk)
        powers = tuple(
            1.5 if jerks and not moves and float(np.linalg.norm(end.alpha_body)) > rest else 1.0
            for end, moves in zip((first, last), is_moving, strict=True)
        )
        ramp = max(limits.acceleration / limits.jerk, period) if jerks else math.inf
        segments = len(keyframe_path.segment.curve.knots) - 1
        least, most = (segments * steps for steps in _STEPS_A_SEGMENT)
        wanted = _RAMP_STEPS * keyframe_path.duration / ramp
        count = max(_FEWEST_STEPS, least, math.ceil(min(wanted, max(_MOST_STEPS, most))))
        return cls(keyframe_path, limits, powers, is_moving, count)  # type: ignore[arg-type]  # pairs

    def rates(self) -> list[LimitedRate]:
        """Return everything that is limited along the path."""
        turning, moving = self._derivatives()
        limits = self.limits
        found = [(name, turning, float(getattr(limits, name))) for name in ANGULAR]
        found += [
            (name, turning[:, :, axis : axis + 1], limit)
            for name in ANGULAR
            for axis, limit in enumerate(limits.axes(name))
        ]
        if moving is not None:
            found += [
                ("linear_velocity", moving, limits.linear_velocity),
                ("linear_acceleration", moving, limits.linear_acceleration),
            ]
        rates = [
            LimitedRate.of(name, derivatives, limit)
            for name, derivatives, limit in found
            if math.isfinite(limit) and np.any(derivatives)
        ]
        # The jerk of the path jumps at its knots: near them it is what it is on either side.
        near = self._near_knots()
        beside = [
            rate.beside(near, shift)
            for rate in rates
            if rate.order == 3 and len(near)
            for shift in (-_ASIDE, _ASIDE)
        ]
        return rates + beside

    def _near_knots(self) -> Indices:
        """Return at which of the places that are looked at a knot of the curve is near."""
        curve = self.keyframe_path.segment.curve
        parts = (curve.knots[1:-1] - curve.domain[0]) / (curve.domain[1] - curve.domain[0])
        places = np.linspace(0.0, 1.0, 4 * self.count + 1)
        before = np.searchsorted(unit_map(places, self.powers)[0], parts, side="right") - 1
        near = np.unique((before[:, None] + np.arange(-1, 3)) // 2)
        return near[(near > _ASIDE) & (near < 2 * self.count - _ASIDE)]

    def solved(self, rates: list[LimitedRate]) -> Profile:
        """Return the profile of the shortest time.

        Raises:
            PlanError: there is none.
        """
        start, end = self._ends()
        highest = np.full(2 * self.count + 1, _FASTEST / self.keyframe_path.duration**2)
        bounds = []
        for rate in rates:
            columns = rate.aimed
            if rate.order == 1:
                square = np.einsum("nk,nk->n", columns[0], columns[0])
                with np.errstate(divide="ignore"):
                    np.minimum(highest, 1.0 / square, out=highest)
            else:
                bound = Bound(columns, rate.order == 3)
                if rate.near is None:
                    bounds.append(_eased(bound, start, end))
                else:
                    bounds.append(replace(bound, columns=columns[:, rate.near], places=rate.near))
        for place, given in ((0, start), (-1, end)):
            if given is not None:
                highest[place] = max(highest[place], given.square / _EASED)
        guess = self._guess(highest, bounds, start, end)
        step = 1.0 / self.count
        try:
            return fastest_profile(step, highest, bounds, guess, start=start, end=end)
        except ProfileError as error:
            raise PlanError(f"no quickest timing was found: {error}") from error

    def _derivatives(self) -> tuple[Floats, Floats | None]:
        """Return the derivatives of the path by the parameter, first to third, ``(3, m, 3)``.

        Those of the orientation in body components, and those of the position if it moves, at the
        nodes and at three places between each and the next.
        """
        places = np.linspace(0.0, 1.0, 4 * self.count + 1)
        duration = self.keyframe_path.duration
        s, slope, bend = unit_map(places, self.powers)
        slope, bend = duration * slope[:, None], duration * bend[:, None]
        times = duration * s
        _, omega, alpha = self.keyframe_path.segment.sample(times)

        def arranged(first: Floats, second: Floats) -> Floats:
            p, pp = first * slope, second * slope**2 + first * bend
            return np.stack([p, pp, np.gradient(pp, places, axis=0, edge_order=1)])

        positions = self.keyframe_path.positions
        if positions.is_held:
            return arranged(omega, alpha), None
        return arranged(omega, alpha), arranged(*motion_of(positions, times, duration))

    def _ends(self) -> tuple[End | None, End | None]:
        """Return what is given where the path moves: the rate and the change of rate it has."""
        ends: list[End | None] = []
        for place, moves in zip((0.0, 1.0), self.is_moving, strict=True):
            _, slope, bend = (
                self.keyframe_path.duration * float(part[0])
                for part in unit_map(np.array([place]), self.powers)
            )
            ends.append(End(slope**-2, -2.0 * bend / slope**3) if moves else None)
        return ends[0], ends[1]

    def _guess(
        self, highest: Floats, bounds: list[Bound], start: End | None, end: End | None
    ) -> Floats:
        """Return a profile that keeps the limits where it does not have to change."""
        y = highest.copy()
        for bound in bounds:
            if bound.places is not None:
                continue
            size = np.sqrt(np.einsum("nk,nk->n", bound.columns[0], bound.columns[0]))
            with np.errstate(divide="ignore"):
                y = np.minimum(y, (1.0 / size) ** (2.0 / 3.0 if bound.is_jerk else 1.0))
        if start is None and end is None:
            return np.full(self.count + 3, 0.5 * float(y.min()))
        # About the timing that the path has, where that is not too quick for an end at rest.
        level = 0.5 * float(y.min())
        places = np.linspace(0.0, 1.0, self.count + 1)
        slope = self.keyframe_path.duration * unit_map(places, self.powers)[1]
        values = 1.0 / (slope**2 + (1.0 / level if 1.5 in self.powers else 0.0))
        return np.concatenate([values[:1], values, values[-1:]])

    def retimed(self, profile: Profile) -> KeyframePath:
        """Return the keyframe path at the speed of a profile.

        Raises:
            PlanError: the profile is not positive between its nodes.
        """
        y, slope, _ = profile.at(0.0)
        points, weights = _GAUSS
        between = np.stack([profile.at(0.5 * (1.0 + x))[0] for x in points.tolist()])
        # Positive where the search looks does not mean positive everywhere.
        if not np.all(between > 0.0):
            raise PlanError("no quickest timing was found: it would stand still on the way")
        inverse = sum(w * square**-0.5 for w, square in zip(weights.tolist(), between, strict=True))
        times = np.concatenate([[0.0], np.cumsum(0.5 * profile.step * np.asarray(inverse))])
        places = np.linspace(0.0, 1.0, self.count + 1)
        keyframe_path = self.keyframe_path
        curve, duration = keyframe_path.segment.curve, float(times[-1])
        nodes = np.stack([places, np.sqrt(y), 0.5 * slope])
        first, last = curve.domain
        warp = TimeMap(times, nodes, first, last - first, self.powers)
        # The same on the clock of the keyframe path, which positions and keyframes are on.
        clock = TimeMap(times, nodes, 0.0, keyframe_path.duration, self.powers)
        return KeyframePath(
            PathSegment(Retimed(curve, warp), 0.0, duration),
            repositioned(keyframe_path.positions, clock),
            clock.times_of(keyframe_path.times),
        )


def _eased(bound: Bound, start: End | None, end: End | None) -> Bound:
    """Return a bound that what is given at the ends keeps: nothing can be done about that."""
    columns = bound.columns.copy()
    for place, given in ((0, start), (-1, end)):
        if given is None or bound.is_jerk:
            continue
        value = columns[0, place] * given.square + columns[1, place] * given.slope
        size = float(np.linalg.norm(value))
        if size > _EASED:
            columns[:, place] *= _EASED / size
    return Bound(columns, bound.is_jerk)
