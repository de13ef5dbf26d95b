"""Refusals: what is wrong with a motion, by how much, where, and how to correct it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from orientd.errors import LimitError, LimitKind, PlanError, StartError
from orientd.model.limits import ANGULAR, AXES, LONGEST, UNITS, Limits
from orientd.model.request import DEFAULT_METHOD, MotionRequest, Pace
from orientd.planner.certify.brake import longest_stop_beside, longest_stop_from
from orientd.planner.certify.certificate import Peak
from orientd.planner.certify.measuring import Peaks
from orientd.planner.errors import AxisLimitError, TotalError
from orientd.planner.state import State
from orientd.rotation import Floats, angle
from orientd.tolerances import GUARD_TOLERANCE

SHORTEST_INTERVAL = 1e-12  # s; derivatives over shorter ones may overflow
SAME_ORIENTATION = 1e-6  # rad
SAME_POSITION = 1e-6  # m
SAME_VELOCITY = 1e-6  # rad/s
SAME_ACCELERATION = 1e-4  # of the limit
_ROUNDING = 1e-6  # relative, of a peak against its limit
_ROOM = 1.02  # times the shortest duration that is suggested

POWERS = {
    LimitKind.VELOCITY: 1,
    LimitKind.ACCELERATION: 2,
    LimitKind.JERK: 3,
    LimitKind.TIME: 1,
}
"""Exponents by which quantities fall when a motion takes longer; its stops take less time too."""

_QUANTITIES = {
    "velocity": "angular velocity",
    "acceleration": "angular acceleration",
    "jerk": "angular jerk",
    "linear_velocity": "velocity of the position",
    "linear_acceleration": "acceleration of the position",
}


_ABOUT = ("", *(f" about {axis}" for axis in AXES))
"""The limited quantities: the norm and the components."""


def check_total(total: float, least: float) -> None:
    """Raise :class:`.TotalError` for a duration shorter than the fastest, s; or for one of days."""
    check_duration(total)
    if total < least * (1.0 - _ROUNDING):
        raise TotalError(total, least)


def check_duration(duration: float) -> None:
    """Raise :class:`.PlanError` for motions that would take days."""
    if not duration <= LONGEST:
        raise PlanError(f"the keyframes take {duration:.6g} s, at most {LONGEST:g} s is planned")


def check_intervals(request: MotionRequest, times: Floats) -> None:
    """Raise :class:`.PlanError` for an interval too short for any clock."""
    steps = np.diff(times)
    index = int(np.argmin(steps))
    if not steps[index] >= SHORTEST_INTERVAL:
        raise PlanError(
            f"{request.named(index + 1)} follows {request.named(index)} after "
            f"{steps[index]:.3g} s, at least {SHORTEST_INTERVAL:g} s is planned"
        )


def check_end_velocities(
    omega_start: Floats | None, omega_end: Floats | None, limits: Limits
) -> None:
    """Raise :class:`.LimitError` for a velocity at an end that exceeds the limit by itself."""
    for name, omega in (("start_velocity", omega_start), ("end_velocity", omega_end)):
        if omega is not None:
            check_velocity(name, omega, limits)


def check_velocity(field: str, omega: Floats, limits: Limits) -> None:
    """Raise :class:`.LimitError` for a velocity that a *field* of a request may not ask for."""
    _check_rate("velocity", omega, limits, 0.0, f"{field} asks for it")


def check_present_rates(start: State, limits: Limits, period: float) -> None:
    """Raise :class:`.LimitError` if the current motion is too far beyond a limit for one cycle.

    A motion has one set of limits from its first record on, and so have the stops on its path.  No
    part of it could brake above them.
    """
    advice = (
        "the device already moves that fast: stop it first, which keeps the device's own limits, "
        "or ask for no lower limit than that"
    )
    _check_rate("velocity", start.omega_body, limits, limits.acceleration * period, advice)
    _check_rate("acceleration", start.alpha_body, limits, 2.0 * limits.jerk * period, advice)


def _check_rate(name: str, vector: Floats, limits: Limits, change: float, advice: str) -> None:
    """Refuse a rate whose norm or a component exceeds its limit by more than *change*."""
    components = vector.tolist()
    # Unlike the root of the sum of squares, hypot does not overflow.
    sizes = math.hypot(*components), *map(abs, components)
    allowed = getattr(limits, name), *limits.axes(name)
    for axis, size, most in zip(_ABOUT, sizes, allowed, strict=True):
        if size - change > most * (1.0 + _ROUNDING):
            quantity = _QUANTITIES[name] + axis
            kind = LimitKind(name)
            raise LimitError(quantity, size, most, 0.0, UNITS[name], advice, kind=kind)


def check_continuity(request: MotionRequest) -> None:
    """Raise :class:`.PlanError` for a curve whose velocity jumps at any pace."""
    if _has_jumps(request):
        raise PlanError(f"no duration keeps the limits: {_JUMPS}")


def check_smooth(request: MotionRequest, continuity: int) -> None:
    """Raise :class:`.PlanError` for a curve whose acceleration has steps at any pace."""
    if continuity < 2:
        raise PlanError(
            f"the quickest pace needs a curve whose acceleration is continuous; {request.method} "
            f"is only C{continuity} here, {DEFAULT_METHOD} is C2 and passes the same keyframes"
        )


def check_start(start: State, first: State, limits: Limits) -> None:
    """Raise :class:`.StartError` if a motion does not begin in the commanded state of the device.

    Args:
        start: the commanded state of the device.
        first: the state at the first keyframe.
        limits: scale of the tolerance of the acceleration.
    """
    different = differences(start, first, limits)
    if different:
        raise StartError(
            "the first keyframe differs from the commanded state of the device: "
            f"{', '.join(different)}; set `approach: true` to plan a lead-in"
        )


def differences(start: State, first: State, limits: Limits) -> list[str]:
    """Return in which quantities two states differ, and by how much; see :func:`check_start`."""
    turn = float(angle(start.q, first.q))
    move, velocity, acceleration = (
        math.dist(getattr(start, name).tolist(), getattr(first, name).tolist())
        for name in ("position", "omega_body", "alpha_body")
    )
    different = []
    if not turn <= SAME_ORIENTATION:
        different.append(f"orientation by {turn:.6g} rad ({math.degrees(turn):.4g} deg)")
    if not move <= SAME_POSITION:
        different.append(f"position by {move:.6g} m")
    if not velocity <= SAME_VELOCITY:
        different.append(f"angular velocity by {velocity:.6g} rad/s")
    if not acceleration <= max(SAME_ACCELERATION * min(limits.acceleration, 1e3), SAME_VELOCITY):
        different.append(f"angular acceleration by {acceleration:.6g} rad/s^2")
    return different


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The path times of the parts of a motion.

    Attributes:
        request: the request of the motion.
        begin: path time of the first keyframe, s.
        end: path time of the last keyframe, s.
        times: path times of all keyframes, s.
    """

    request: MotionRequest
    begin: float
    end: float
    times: Floats

    def name(self, time: float) -> str:
        """Return a path time in the user's terms."""
        if time < self.begin:
            return "in the lead-in"
        if time > self.end:
            return "in the lead-out"
        place = between(self.request, self.times, time)
        if self.request.times is None:
            return place
        return f"{place}, at {time - self.begin + self.request.times[0]:.6g} s of their time"


def between(request: MotionRequest, times: Floats, time: float) -> str:
    """Return between which keyframes a path is.

    Args:
        request: has the keyframes.
        times: path times of the keyframes, s.
        time: of the path, s.
    """
    if len(times) == 1:
        return f"on the way to {request.named(0)}"
    index = int(np.searchsorted(times, time, side="right")) - 1
    index = max(min(index, len(times) - 2), 0)
    return f"between {request.named(index)} and {request.named(index + 1)}"


def stopping_first(error: PlanError) -> PlanError:
    """Return the refusal of a motion of a moving device that may be possible from rest."""
    advice = "stop first: from rest the axes may turn there in another way"
    if not isinstance(error, LimitError):
        return PlanError(f"{error}; {advice}")
    return LimitError(
        error.quantity, error.value, error.limit, error.time, error.unit, advice, kind=error.kind
    )


def of_attempts(refused: Mapping[str, PlanError]) -> PlanError:
    """Return the refusal of a motion after several attempts, by their names, in order."""
    errors = list(refused.values())
    totals = [one for one in errors if isinstance(one, TotalError)]
    # The least duration tells most.
    error = min(totals, key=attrgetter("least"), default=errors[0])
    others = [name for name, one in refused.items() if one is not error]
    if others:
        error.args = (f"{error}; tried before: {', '.join(others)}",)
    return error


def name_pace(error: PlanError, pace: Pace | float | None) -> None:
    """Add the pace of a request, which lowers the limits, to the words of its refusal."""
    if isinstance(pace, float | int) and pace < 1.0 and not isinstance(error, StartError):
        error.args = (
            f"{error}; a pace of {pace:g} leaves {100.0 * pace:.3g} % of the velocity, "
            f"{100.0 * pace**2:.3g} % of the acceleration and {100.0 * pace**3:.3g} % of the jerk",
        )


def of_any_duration(start: State, limits: Limits) -> PlanError:
    """Return the refusal of a motion that breaks a limit at any duration."""
    problem = (
        f"no duration keeps the limits of {limits.velocity:g} rad/s, {limits.acceleration:g} "
        f"rad/s^2 and {limits.jerk:g} rad/s^3"
    )
    if not start.is_at_rest:
        problem += (
            f" on a path that begins with {np.linalg.norm(start.omega_body):.4g} rad/s and "
            f"{np.linalg.norm(start.alpha_body):.4g} rad/s^2; set `approach: true` for a lead-in"
        )
    return PlanError(problem)


def check_limits(peaks: Peaks, place: Place) -> None:
    """Raise :class:`.LimitError` for a motion that breaks a limit; it names the one broken most."""
    broken: list[tuple[float, str, str, Peak]] = []
    for name in UNITS:
        of_axes: tuple[Peak, ...] = getattr(peaks, f"axis_{name}") if name in ANGULAR else ()
        for axis, peak in zip(_ABOUT, (getattr(peaks, name), *of_axes), strict=False):
            # Written so that a NaN counts as broken.  Between the records, the guard's tolerance
            # keeps a motion on its path.
            if not (peak.planned_ratio <= 1.0 + _ROUNDING and peak.ratio <= GUARD_TOLERANCE):
                ratio = peak.ratio if math.isfinite(peak.ratio) else math.inf
                broken.append((ratio, name, axis, peak))
    if not broken:
        _check_axes(peaks, place)
        return
    _, name, axis, peak = max(broken, key=lambda entry: entry[0])
    advice = place.name(peak.time)
    if _has_jumps(place.request):
        advice = f"{advice}; {_JUMPS}"
    is_in_lead_in = peak.time < place.begin
    raise LimitError(
        _QUANTITIES[name] + axis, peak.value, peak.limit, peak.time, UNITS[name], advice,
        kind=LimitKind(name.removeprefix("linear_")), is_in_lead_in=is_in_lead_in,
    )  # fmt: skip


def _check_axes(peaks: Peaks, place: Place) -> None:
    """Raise :class:`.AxisLimitError` for the axis of the device that breaks a limit most."""
    # Written so that a NaN counts as broken.
    needs = [
        0.0 if value <= limit * GUARD_TOLERANCE else _longer(kind, value / limit)
        for kind, _, value, limit, _ in peaks.axes
    ]
    if not any(needs):
        return
    longer = max(needs)
    kind, axis, value, limit, time = peaks.axes[needs.index(longer)]
    advice = (
        "at a record or between two records; allow the motion more time, or keep away from "
        "singularities"
    )
    if place.request.times is not None and place.begin <= time <= place.end:
        lasts = place.end - place.begin
        advice = f"{_ROOM * longer * lasts:.1f} s in place of {lasts:.1f} s would do"
    raise AxisLimitError(
        f"{kind.value} of {axis.name}", value, limit, time, UNITS[kind.value],
        f"{place.name(time)}; {advice}", kind=kind,
    )  # fmt: skip


def _longer(kind: LimitKind, over: float) -> float:
    """Return the factor by which a motion must take longer for a rate to fall by a factor."""
    return over ** (1.0 / POWERS[kind]) if math.isfinite(over) else math.inf


def check_stop(peaks: Peaks, place: Place, limits: Limits) -> None:
    """Raise :class:`.LimitError` for a motion with too long a stop on its path.

    Timings of the planner keep their reserve, so only a motion with times of the user can exceed
    the bound that they keep.
    """
    request, longest = place.request, math.inf
    if request.times is not None:
        ends = (one for one in (request.start_velocity, request.end_velocity) if one is not None)
        fastest = max((math.hypot(*omega) for omega in ends), default=0.0)
        usual = longest_stop_from(peaks.velocity.value, limits)
        longest = max(usual, longest_stop_beside(fastest, limits))
    stop_time = 1.0 / peaks.brake_rate if peaks.brake_rate > 0.0 else math.inf
    if stop_time > longest or math.isinf(stop_time):
        raise LimitError(
            "the time that a stop on the path takes",
            stop_time,
            longest,
            peaks.brake_time,
            "s",
            f"{place.name(peaks.brake_time)}, where too little reserve is left to slow down with",
            kind=LimitKind.TIME,
        )


def _has_jumps(request: MotionRequest) -> bool:
    return request.method == "piecewise_slerp" and len(request.keyframes) > 2


_JUMPS = (
    "piecewise_slerp is only C0, its velocity jumps at every keyframe; "
    f"{DEFAULT_METHOD} is C2 and passes the same keyframes"
)
