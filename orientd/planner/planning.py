"""From a request to a motion: geometry, timing, leads, certificate."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from orientd.curves import METHODS, corrections_at_most
from orientd.errors import LimitError, PlanError, StartError
from orientd.planner import refusal
from orientd.planner.candidate import CandidateMotion, to_single, with_leads
from orientd.planner.certifying import certified
from orientd.planner.connect import Caution, LeadIn, lead_in, position_lead
from orientd.planner.keyframes import in_device_coordinates, with_least_roll, wound
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.methods import Ends, check_method
from orientd.planner.motion import Motion
from orientd.planner.request import MotionRequest, State
from orientd.planner.timing import (
    LONGER,
    SHARE,
    Indices,
    KeyframePath,
    PathRequest,
    Survey,
    chord_knots,
    quickest,
    shortest,
)
from orientd.rotation import Floats

_CYCLES_A_STEP = 4
_LONGEST_SEARCH = 256  # times as long as the first guess, where longer ones are other curves
_MOST_REFUSALS = 10  # of leads, the last one at some four times the duration of the first
_HOPELESS = 1e3  # times as long as a motion may take, with each keyframe
_MOST_CORRECTIONS = 300  # of a curve that is one of many to try
_LONGEST_STOP = 6.0  # s, on longer motions of minimum duration; so much of a path is read ahead
_LEAST_SHARE = 0.2  # of acceleration and jerk, below which they would not be the quickest
_MOST_DRAWN = 1.1  # times what is on the records is the most that is drawn between them
_MOST_TIMINGS = 12  # until a stop is short enough, each of them a whole search
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
    as quickly as the limits permit, with a reserve for a stop on the path; at the curve's own
    pace, or with ``duration="minimum"`` at the highest pace everywhere.  The motion begins in
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
    request = in_device_coordinates(request, start)
    request = with_least_roll(wound(request, start), start)
    job = _Job.of(request, start, limits.narrowed(request.limits), period)
    name = motion_id or os.urandom(6).hex()
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


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """One call of :func:`plan`.

    Attributes:
        request: what was asked for.
        start: where the device is commanded to be.
        limits: to keep.
        period: of the device, s.
        ends: velocities at the first and last keyframe.
        caution: with which to lead in.
        leads: lead-ins already found, by the state they lead to.
    """

    request: MotionRequest
    start: State
    limits: Limits
    period: float
    ends: Ends
    caution: Caution = Caution.NONE
    leads: dict[bytes, LeadIn] = field(default_factory=dict)

    @classmethod
    def of(cls, request: MotionRequest, start: State, limits: Limits, period: float) -> _Job:
        """Check what can be checked before a curve is made."""
        method = check_method(request)
        if request.limits is not None:
            refusal.check_present_rates(start, limits, period)
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
        return cls(request, start, limits, period, ends)

    def motion(self, name: str) -> Motion:
        """Return the motion, certified."""
        if self.request.is_single:
            return self.certified(self.as_single(), name)
        if self.request.duration is not None:
            return self.in_minimum_time(name)
        if self.request.times is not None:
            return self.certified(self.as_timed(), name)
        try:
            return self.certified(self.as_quick_as_possible(everywhere=False), name)
        except LimitError:
            # A peak where none was expected: look at every record then.
            return self.certified(self.as_quick_as_possible(everywhere=True), name)

    def as_single(self) -> CandidateMotion:
        """Return the path to the only keyframe."""
        return to_single(self.request, self.start, self.limits, self.period, self.caution)

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

    def as_quick_as_possible(self, *, everywhere: bool) -> CandidateMotion:
        """Return the path with the shortest times that keep the limits, in whole periods.

        Args:
            everywhere: whether to look at every record at every attempt.
        """
        period, reserved = self.period, self.limits.with_reserve()
        path_request, shape = self._shape()
        is_same = path_request.has_one_shape
        is_held = is_same and shape.is_held_at_both_ends(self.limits)
        survey = Survey.of(shape, reserved, period, has_one_shape=is_same)
        guess = shape.duration * survey.factor
        if is_same:
            refusal.check_duration(guess)
        # Two steps of the acceleration within a difference of the setpoints would add up.
        fewest = 1 if shape.continuity >= 2 else _CYCLES_A_STEP * (len(path_request.kept) - 1)
        drafts: dict[int, CandidateMotion] = {}
        cores: dict[int, KeyframePath] = {}
        refusals: list[PlanError] = []

        def attempt(cycles: int, *, are_led: bool) -> float:
            duration = cycles * period
            try:
                # The same curve at another rate need not be made again.
                keyframe_path = (
                    shape.slowed(duration) if is_same else self._moving(path_request, duration)
                )
            except PlanError:
                return math.inf
            try:
                factor = survey.look(keyframe_path, reserved, period, everywhere=everywhere)
                if factor <= 1.0:
                    cores[cycles] = keyframe_path
                    if are_led:
                        drafts[cycles] = self._with_leads(keyframe_path)
            except StartError:
                raise
            except PlanError as error:
                refusals.append(error)
                if len(refusals) == _MOST_REFUSALS:
                    raise
                return LONGER
            return factor

        most = int(LONGEST / period)
        if is_same:
            first = math.ceil(guess / period)
        else:
            # There is a curve of that duration; a longer one may swing out further.
            known = math.ceil(shape.duration / period)
            first = math.ceil(guess / period) if guess <= 2 * known * period else known
            most = min(most, _LONGEST_SEARCH * known)
        # From hold to hold the leads are the same for any duration.  Elsewhere what is found mostly
        # has leads; otherwise every attempt counts with its own.
        for are_led in (False,) if is_held else (False, True):
            some = partial(attempt, are_led=are_led)
            cycles = shortest(some, first, least=fewest, most=most, has_one_shape=is_same)
            if cycles is None:
                break
            try:
                return drafts.get(cycles) or self._with_leads(cores[cycles])
            except StartError:
                raise
            except PlanError:
                if is_held:
                    raise
                first = cycles
        raise refusals[-1] if refusals else refusal.of_any_duration(self.start, self.limits)

    def _shape(self) -> tuple[PathRequest, KeyframePath]:
        """Return the path request of keyframes without times, and a path of about its duration."""
        refusal.check_continuity(self.request)
        is_uniform = not METHODS[self.request.method].interpolates
        knots = chord_knots(self.request, self.limits, is_uniform=is_uniform)
        path_request = self._course(knots.times, knots.kept)
        guess = knots.first_guess(self.limits.with_reserve())
        if path_request.has_one_shape and guess > _HOPELESS * len(knots.times) * LONGEST:
            refusal.check_duration(guess)
        guess = min(max(guess, 2.0 * self.period), LONGEST)
        return path_request, path_request.keyframe_path(
            guess
        ) if path_request.has_one_shape else self._moving(path_request, guess)

    def _moving(self, path_request: PathRequest, duration: float) -> KeyframePath:
        """Return one of many keyframe paths to try, each of which may be hard to find."""
        with corrections_at_most(_MOST_CORRECTIONS):
            return path_request.keyframe_path(duration)

    def in_minimum_time(self, motion_id: str) -> Motion:
        """Return the motion along the keyframe path as quickly as the limits permit."""
        path_request, keyframe_path = self._shape()
        refusal.check_smooth(self.request, keyframe_path.continuity)
        if not (path_request.has_one_shape and keyframe_path.is_from_rest_to_rest):
            # A velocity at an end is one at some duration: take the curve of the usual one.
            keyframe_path = (
                self.as_quick_as_possible(everywhere=False).keyframe_path or keyframe_path
            )
        share = SHARE
        for count in range(_MOST_TIMINGS):
            quick = quickest(keyframe_path, self.limits, self.period, share=share)
            try:
                motion = self.certified(self._with_leads(quick), motion_id)
            except LimitError as error:
                # What is drawn between the records is a little more, where the jerk has a step.
                over = error.value / error.limit
                if not (1.0 < over <= _MOST_DRAWN and share > _LEAST_SHARE):
                    raise
                share /= over
                continue
            stop_time = motion.certificate.stop_time
            if stop_time <= _LONGEST_STOP or motion.duration <= _LONGEST_STOP:
                return motion
            if share <= _LEAST_SHARE:
                break
            # How fast a stop can be goes with the square root of the reserve.
            more = 1.05 * (stop_time / _LONGEST_STOP) ** 2
            if count >= _PATIENCE:
                more = max(more, 2.0)
            share = max(1.0 - more * (1.0 - share), _LEAST_SHARE)
        raise refusal.of_slow_stop(stop_time, _LONGEST_STOP, share)

    def certified(self, candidate: CandidateMotion, motion_id: str) -> Motion:
        """Return the motion, held against its limits on the records that will be sent."""
        return certified(
            candidate, self.request, self.start, self.limits, self.period, motion_id=motion_id
        )

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
            first = State(first.q, first.omega_body, first.alpha_body, at)
            lead = self.leads[key] = lead_in(
                self.start, first, limits=self.limits, period=self.period, caution=self.caution
            )
        return lead
