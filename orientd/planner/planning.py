"""From a request to a motion: geometry, timing, leads, certificate."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from orientd.curves import METHODS, corrections_at_most
from orientd.errors import LimitError, PlanError, StartError
from orientd.planner import refusal
from orientd.planner.candidate import CandidateMotion, to_single, with_leads
from orientd.planner.certifying import certified
from orientd.planner.connect import (
    STOPS,
    Caution,
    LeadIn,
    lead_in,
    position_lead,
    turns_with_stops,
)
from orientd.planner.keyframes import at_rate, in_device_coordinates, with_least_roll, wound
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.methods import Ends, check_method
from orientd.planner.motion import Motion
from orientd.planner.request import MotionRequest, State
from orientd.planner.timing import (
    LEAST_SHARE,
    LONGEST_STOP,
    SHARE,
    FirstProfile,
    Indices,
    KeyframePath,
    PathRequest,
    aimed_at,
    chord_knots,
    evenly_paced,
    quickest,
    with_chosen_times,
)
from orientd.rotation import Floats

_HOPELESS = 1e3  # times as long as a motion may take, with each keyframe
_MOST_CORRECTIONS = 300  # of a curve that is one of many to try
_MOST_DRAWN = 1.1  # times what is on the records is the most that is drawn between them
_MOST_TIMINGS = 12  # until a stop is short enough, each of them a whole search
_NO_LONGER = 0.98  # of a stop's time, above which a larger reserve has not helped
_PATIENCE = 3  # timings after which the reserve is at least doubled by each


def plan(
    request: MotionRequest,
    *,
    start: State,
    limits: Limits,
    period: float,
    motion_id: str | None = None,
) -> Motion:
    """Return the motion that a request asks for, or refuse it.

    Keyframes with times are passed at those times, or not at all; keyframes without are passed
    as quickly as the limits permit at every point of the curve, or with ``pace="even"`` at the
    curve's own pace, slowed down by one factor.  Where no quickest timing is found the pace is
    even, too, which a note of the certificate says.  The motion begins in
    the state the device is commanded to be in and ends at rest: in front of the keyframes goes a
    lead-in where the request says ``approach``, behind them a lead-out where they end with a
    velocity or an acceleration.  A single keyframe is where to go, by the shortest way found.

    A start that moves is the state of another motion at one of its records, which this one takes
    over with continuous acceleration; the certificate covers the differences across the seam.

    Args:
        request: what to do.
        start: where the device is commanded to be.
        limits: the device's.
        period: the device's cycle, s.
        motion_id: names the motion; by default a new random name.

    Raises:
        RequestError: the request is not one that its method or the device allows.
        LimitError: the motion would break a limit.
        StartError: it does not begin where the device is commanded to be.
        PlanError: it cannot be planned for another reason.
        ValueError: *period* is not positive.
    """
    if not (math.isfinite(period) and period > 0.0):
        raise ValueError(f"period must be positive, got {period} s")
    within, name = limits.narrowed(request.limits), motion_id or os.urandom(6).hex()
    turned = at_rate(in_device_coordinates(request, start), start, within)
    request = with_least_roll(wound(turned, start), start)
    job = _Job.of(request, start, within, period)
    if not request.approach or (start.is_at_rest and not request.is_single):
        return job.motion(name)
    first: LimitError | None = None
    for caution in Caution:
        try:
            if caution is not job.caution:
                job = replace(job, caution=caution, leads={})
            return job.motion(name)
        except LimitError as error:
            first = first or error
    raise first or PlanError("no lead-in was tried")


def _noted(motion: Motion, note: str) -> Motion:
    """Return a motion with one more note in its certificate."""
    notes = (*motion.certificate.notes, note)
    return replace(motion, certificate=replace(motion.certificate, notes=notes))


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """One call of :func:`plan`.

    Attributes:
        request: what was asked for.
        start: where the device is commanded to be.
        limits: to keep: a share of the own ones where a pace is one of the quickest.
        own: what the motion is held against.
        period: of the device, s.
        ends: velocities at the first and last keyframe.
        is_even: whether the way from rest to the first keyframe keeps the reserve of an even pace,
            as it does where keyframes have times: these ask for stops that take less time.
        caution: with which to lead in.
        leads: lead-ins already found, by the state they lead to.
        merged: what there is to say of keyframes that are passed as one.
    """

    request: MotionRequest
    start: State
    limits: Limits
    own: Limits
    period: float
    ends: Ends
    is_even: bool
    caution: Caution = Caution.NONE
    leads: dict[bytes, LeadIn] = field(default_factory=dict)
    merged: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, request: MotionRequest, start: State, own: Limits, period: float) -> _Job:
        """Check what can be checked before a curve is made."""
        limits = own.slowed(request.pace) if isinstance(request.pace, float | int) else own
        method = check_method(request)
        if request.limits is not None:
            refusal.check_present_rates(start, own, period)
        omega_start, alpha_start = request.omega_start, None
        if not start.is_at_rest and not request.approach:
            # The motion takes over from another one that is still moving.
            if method.has_velocities and omega_start is None:
                omega_start = start.omega_body
            if method.has_accelerations:
                alpha_start = start.alpha_body
        refusal.check_end_velocities(omega_start, request.omega_end, limits)
        if not request.approach:
            # Every curve begins at its first keyframe, with the velocity that was asked for: none
            # need be made to see that the device is elsewhere.
            omega = start.omega_body
            if method.has_velocities:
                omega = np.zeros(3) if omega_start is None else omega_start
            first = replace(start, q=request.keys[0], omega_body=omega)
            refusal.check_start(start, first, limits)
        ends = Ends(omega_start, request.omega_end, alpha_start)
        return cls(request, start, limits, own, period, ends, not request.is_quickest)

    def motion(self, name: str) -> Motion:
        """Return the motion, certified."""
        if self.request.is_single:
            return self.to_single(name)
        if self.request.times is not None:
            return self.certified(self.as_timed(), name)
        if self.is_even:
            return self.at_even_pace(name)
        motion, took, refused = None, math.inf, None
        try:
            motion = self._quick_or_even(name)
            took = motion.end_time - motion.start_time
        except (StartError, refusal.TotalError):
            raise
        except PlanError as error:
            refused = error
        stops = turns_with_stops(self.request, self.ends, self.start, self.limits, took)
        if stops is not None and stops.duration < took:
            with suppress(PlanError):
                return _noted(self.certified(self._with_leads(stops), name), STOPS)
        if motion is None:
            raise refused or PlanError("no motion was tried")
        return motion

    def _quick_or_even(self, name: str) -> Motion:
        try:
            try:
                return self.as_quick_as_possible(name)
            except LimitError:
                return self.as_quick_as_possible(name, by_chord=True)
        except (StartError, refusal.TotalError):
            raise
        except PlanError as error:
            even = replace(self, is_even=True, leads={})
            return _noted(even.at_even_pace(name), f"at an even pace: {error}")

    def at_even_pace(self, name: str) -> Motion:
        """Return the motion at the curve's own pace, slowed down by one factor."""
        if self.request.total is not None:
            refusal.check_duration(self.request.total)
            path_request, *_ = self._shape(is_quick=False)
            core = self._moving(path_request, self.request.total)
            return self.certified(self._with_leads(core), name)
        try:
            return self.certified(self.evenly_paced(everywhere=False), name)
        except LimitError:
            # A peak where none was expected: look at every record then.
            return self.certified(self.evenly_paced(everywhere=True), name)

    def to_single(self, name: str) -> Motion:
        """Return the motion to the only keyframe."""
        share = SHARE
        for _ in range(_MOST_TIMINGS):
            candidate = to_single(
                self.request,
                self.start,
                self.limits,
                self.period,
                self.caution,
                is_even=self.is_even,
                jerk_share=share,
            )
            try:
                return self.certified(candidate, name)
            except LimitError as error:
                over = error.value / error.limit
                if self.is_even or not self.start.is_at_rest or not 1.0 < over <= _MOST_DRAWN:
                    raise
                # What is drawn between the records is a little more, where the jerk has a step.
                share /= over
        return replace(self, is_even=True).to_single(name)

    def as_timed(self) -> CandidateMotion:
        """Return the path with the times of the request."""
        if self.request.times is None:
            raise ValueError("request must have times")
        times = self.request.times - self.request.times[0]
        duration = float(times[-1])
        refusal.check_duration(duration)
        refusal.check_intervals(times)
        keyframe_path = self._course(times, np.arange(len(times))).keyframe_path(duration)
        try:
            return self._with_leads(keyframe_path)
        except StartError:
            raise
        except PlanError:
            # No lead can mend a path that breaks a limit by itself: then that is what is wrong.
            place = refusal.Place(self.request, 0.0, duration, keyframe_path.times)
            refusal.check_limits(keyframe_path.peaks(self.period, self.limits), place)
            raise

    def evenly_paced(self, *, everywhere: bool) -> CandidateMotion:
        """Return the path with the shortest times that keep the limits, in whole periods.

        Args:
            everywhere: whether to look at every record at every attempt.
        """
        path_request, shape, _ = self._shape(is_quick=False)
        found = evenly_paced(
            shape,
            self.limits,
            self.period,
            intervals=len(path_request.kept) - 1,
            other=None if path_request.has_one_shape else partial(self._moving, path_request),
            led=self._with_leads,
            everywhere=everywhere,
        )
        if found is None:
            raise refusal.of_any_duration(self.start, self.limits)
        return found

    def _shape(self, *, is_quick: bool) -> tuple[PathRequest, KeyframePath, FirstProfile | None]:
        """Return the path request of keyframes without times, and a path of about its duration.

        Args:
            is_quick: whether to choose times for the quickest way, by the own limits so that the
                path is the same at any share of its pace; a profile comes with it if one is known.
        """
        refusal.check_continuity(self.request)
        is_uniform = not METHODS[self.request.method].interpolates
        knots = chord_knots(self.request, self.limits, is_uniform=is_uniform)
        path_request = self._course(knots.times, knots.kept)
        self.merged[:] = knots.merged(self.request)
        guess = knots.first_guess(self.limits.with_reserve())
        if path_request.has_one_shape and guess > _HOPELESS * len(knots.times) * LONGEST:
            refusal.check_duration(guess)
        guess = min(max(guess, 2.0 * self.period), LONGEST)
        profile = None
        chosen = with_chosen_times(path_request, guess, aimed_at(self.own)) if is_quick else None
        if chosen is not None:
            path_request, profile = chosen
        profile = profile if self.limits is self.own else None
        is_moving = not path_request.has_one_shape
        make = partial(self._moving, path_request) if is_moving else path_request.keyframe_path
        return path_request, make(guess), profile

    def _moving(self, path_request: PathRequest, duration: float) -> KeyframePath:
        """Return one of many keyframe paths to try, each of which may be hard to find."""
        with corrections_at_most(_MOST_CORRECTIONS):
            return path_request.keyframe_path(duration)

    def as_quick_as_possible(self, motion_id: str, *, by_chord: bool = False) -> Motion:
        """Return the motion along the keyframe path as quickly as the limits permit.

        Args:
            motion_id: names the motion.
            by_chord: whether the path is that of an even pace.
        """
        path_request, keyframe_path, profile = self._shape(is_quick=not by_chord)
        refusal.check_smooth(self.request, keyframe_path.continuity)
        if not (path_request.has_one_shape and keyframe_path.is_from_rest_to_rest):
            if self.request.total is not None:
                return self.at_even_pace(motion_id)
            # A velocity at an end is one at some duration: take the curve of the usual one.
            keyframe_path = self.evenly_paced(everywhere=False).keyframe_path or keyframe_path
        share, before, stop_time = SHARE, math.inf, math.inf
        for count in range(_MOST_TIMINGS):
            quick = quickest(keyframe_path, self.limits, self.period, share=share, guess=profile)
            quick = quick.in_total(self.request.total)
            try:
                motion = self.certified(self._with_leads(quick), motion_id)
            except LimitError as error:
                # What is drawn between the records is a little more, where the jerk has a step.
                over = error.value / error.limit
                if not (1.0 < over <= _MOST_DRAWN and share > LEAST_SHARE):
                    raise
                share /= over
                continue
            rate = motion.certificate.brake_rate
            stop_time = 1.0 / rate if rate else math.inf
            if stop_time <= LONGEST_STOP or motion.duration <= LONGEST_STOP:
                return motion
            if count > _PATIENCE and stop_time > _NO_LONGER * before:
                # It is not this timing that is slow to stop, but what leads to it or from it.
                return motion
            before = stop_time
            if share <= LEAST_SHARE:
                break
            # How fast a stop can be goes with the square root of the reserve.
            more = 1.05 * (stop_time / LONGEST_STOP) ** 2
            if count >= _PATIENCE:
                more = max(more, 2.0)
            share = max(1.0 - more * (1.0 - share), LEAST_SHARE)
        raise refusal.of_slow_stop(stop_time, LONGEST_STOP, share)

    def certified(self, candidate: CandidateMotion, motion_id: str) -> Motion:
        """Return the motion, held against its limits on the records that will be sent."""
        motion = certified(
            candidate, self.request, self.start, self.own, self.period, motion_id=motion_id
        )
        for note in self.merged:
            motion = _noted(motion, note)
        return motion

    def _course(self, times: Floats, kept: Indices) -> PathRequest:
        start, given = self.start, self.request.positions
        only = None
        if given is not None and not self.request.approach:
            only = given[np.flatnonzero(np.isfinite(given[:, 0]))[0]]
        halt = position_lead(start, only, limits=self.limits, period=self.period)
        first = (start.position, start.velocity, start.acceleration)
        is_taken_over = start.is_position_moving and not self.request.approach
        return PathRequest(
            self.request,
            self.ends,
            times,
            kept,
            halt,
            first if is_taken_over else None,
        )

    def _with_leads(self, keyframe_path: KeyframePath) -> CandidateMotion:
        lead = self._lead_in(keyframe_path) if self.request.approach else None
        return with_leads(keyframe_path, lead, self.start, self.limits, self.period)

    def _lead_in(self, keyframe_path: KeyframePath) -> LeadIn:
        first, _ = keyframe_path.segment.ends()
        key = first.q.tobytes() + first.omega_body.tobytes() + first.alpha_body.tobytes()
        lead = self.leads.get(key)
        if lead is None:
            at = keyframe_path.positions.first
            lead = self.leads[key] = lead_in(
                self.start,
                State(first.q, first.omega_body, first.alpha_body, at),
                limits=self.limits,
                period=self.period,
                caution=self.caution,
                is_even=self.is_even,
            )
        return lead
