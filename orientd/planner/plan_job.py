"""What a motion is planned from: request, start and limits, and the pieces made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from orientd.curves import METHODS
from orientd.errors import LimitError, PlanError
from orientd.planner import refusal
from orientd.planner.candidate import CandidateMotion, with_leads
from orientd.planner.certify import before, measure_path, summed_up
from orientd.planner.connect import Caution, LeadIn, lead_in, position_lead
from orientd.planner.keyframes import half_turn_notes
from orientd.planner.limits import LONGEST, Limits, is_still
from orientd.planner.methods import Ends, check_method
from orientd.planner.motion import Motion
from orientd.planner.path import PositionPath
from orientd.planner.request import MotionRequest, State
from orientd.planner.timing import (
    FirstProfile,
    Indices,
    KeyframePath,
    PathRequest,
    aimed_at,
    chord_knots,
    with_chosen_times,
)
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

_HOPELESS = 1e3  # times as long as a motion may take, with each keyframe
_END_SLACK = 1e-9  # of a period

Shape = tuple[PathRequest, KeyframePath, FirstProfile | None]
"""What a path is made from, the path in about its duration, and a profile if one is known."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanJob:
    """What a motion is planned from, and the pieces that it is put together of.

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
        shapes: keyframe paths already found, by whether they are for the quickest way.
        timings: the same timed, by path and share of the limits.
        notes: what the certificate says of the request.
        merged: what there is to say of keyframes that are passed as one.
        offset: the index of the first keyframe in the request that this is a part of.
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
    shapes: dict[bool, Shape] = field(default_factory=dict)
    timings: dict[tuple[KeyframePath, float], KeyframePath] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    merged: list[str] = field(default_factory=list)
    offset: int = 0

    @classmethod
    def of(cls, request: MotionRequest, start: State, own: Limits, period: float) -> PlanJob:
        """Check what can be checked before a curve is made."""
        limits = own.slowed(request.pace) if isinstance(request.pace, float | int) else own
        limits = limits.at_period(period)
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
        has_turns = method.has_turns or request.is_single
        notes = (*request.notes, *half_turn_notes(request, start, has_turns=has_turns))
        return cls(request, start, limits, own, period, ends, not request.is_quickest, notes=notes)

    def with_caution(self, caution: Caution) -> PlanJob:
        """Return the job to be led in with *caution*; what is found of its path stays known."""
        return self if caution is self.caution else replace(self, caution=caution, leads={})

    @property
    def is_led_by_connector(self) -> bool:
        """Whether the lead-in goes from a motion, or to one."""
        is_moving = self.request.is_single or self.ends.moves[0] or not self.start.is_at_rest
        return self.request.approach and is_moving

    def is_for_more_caution(self, error: PlanError) -> bool:
        """Return whether what went wrong is the lead-in, and there is another way to lead in."""
        return (
            isinstance(error, LimitError)
            and error.is_in_lead_in
            and self.is_led_by_connector
            and self.caution is not list(Caution)[-1]
        )

    def of_part(self, request: MotionRequest, start: State, offset: int) -> PlanJob:
        """Return the job of a part of the motion, from rest to rest.

        Args:
            request: the keyframes of the part.
            start: at rest at the first of them.
            offset: the index of that keyframe in the request.
        """
        return PlanJob(
            request, start, self.limits, self.own, self.period, Ends(), self.is_even, offset=offset
        )

    def shape(self, *, is_quick: bool) -> Shape:
        """Return what keyframes without times make.

        Args:
            is_quick: whether to choose times for the quickest way, by the own limits so that the
                path is the same at any share of its pace.
        """
        shape = self.shapes.get(is_quick)
        if shape is None:
            shape = self.shapes[is_quick] = self._shape(is_quick=is_quick)
        return shape

    def timed(
        self,
        keyframe_path: KeyframePath,
        share: float,
        find: Callable[..., KeyframePath],
    ) -> KeyframePath:
        """Return a path as *find* times it with a share of the limits, once for all lead-ins."""
        quick = self.timings.get((keyframe_path, share))
        if quick is None:
            quick = self.timings[keyframe_path, share] = find(
                keyframe_path, self.limits, self.period, share=share
            )
        return quick

    def _shape(self, *, is_quick: bool) -> Shape:
        if not is_quick:
            refusal.check_continuity(self.request)
        is_uniform = not METHODS[self.request.method].interpolates
        knots = chord_knots(self.request, self.limits, is_uniform=is_uniform)
        path_request = self.path_request(knots.times, knots.kept)
        self.merged[:] = knots.merged(self.request, self.offset)
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
        make = partial(self.moving, path_request) if is_moving else path_request.keyframe_path
        return path_request, make(guess), profile

    def path_request(self, times: Floats, kept: Indices) -> PathRequest:
        """Return what the keyframe path through the *kept* keyframes is made from."""
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

    def moving(self, path_request: PathRequest, duration: float) -> KeyframePath:
        """Return one of many keyframe paths to try, each of which may be hard to find."""
        return path_request.keyframe_path(duration)

    def with_leads(self, keyframe_path: KeyframePath) -> CandidateMotion:
        """Return the path from hold to hold around a keyframe path."""
        lead = self._lead_in(keyframe_path) if self.request.approach else None
        return with_leads(keyframe_path, lead, self.start, self.limits, self.period)

    def _lead_in(self, keyframe_path: KeyframePath) -> LeadIn:
        first, _ = keyframe_path.segment.ends()
        at = keyframe_path.positions.first
        return self.lead_to(State(first.q, first.omega_body, first.alpha_body, at))

    def lead_to(self, first: State) -> LeadIn:
        """Return the lead-in to a state at the first keyframe.

        Raises:
            PlanError: none was found.
        """
        key = first.q.tobytes() + first.omega_body.tobytes() + first.alpha_body.tobytes()
        lead = self.leads.get(key)
        if lead is None:
            # A position arrives with the approach and waits during the run-up.
            is_moving = not is_still(first.omega_body, first.alpha_body, self.limits)
            is_direct = is_moving and not self.is_even and self.request.positions is None
            lead = self.leads[key] = self.connected(
                self.start, first, self.caution, is_direct=is_direct
            )
        return lead

    def connected(
        self, start: State, first: State, caution: Caution, *, is_direct: bool = True
    ) -> LeadIn:
        """Return the way from one state to another.

        Args:
            start: where it begins.
            first: where it ends.
            caution: with which to connect.
            is_direct: whether a connector is preferred to a run-up where it begins at rest.

        Raises:
            PlanError: none was found.
        """
        find = partial(
            lead_in,
            start,
            first,
            limits=self.limits,
            own=self.own,
            period=self.period,
            caution=caution,
            is_even=self.is_even,
        )
        try:
            return find(is_direct=is_direct)
        except PlanError:
            if not start.is_at_rest:
                raise
            return find(is_direct=not is_direct)

    @property
    def halt(self) -> PositionPath:
        """How a position comes to rest that no keyframe asks for."""
        return position_lead(self.start, None, limits=self.limits, period=self.period)

    def certified(
        self, candidate: CandidateMotion, motion_id: str, merged: Sequence[str] | None = None
    ) -> Motion:
        """Return the motion, held against its limits on the records that will be sent.

        Args:
            candidate: from hold to hold.
            motion_id: names the motion.
            merged: what to say of merged keyframes in place of what the job says.
        """
        motion = certified(
            candidate, self.request, self.start, self.own, self.period, motion_id=motion_id
        )
        return motion.noted(*self.notes, *(self.merged if merged is None else merged))


def certified(
    candidate: CandidateMotion,
    request: MotionRequest,
    start: State,
    limits: Limits,
    period: float,
    *,
    motion_id: str,
) -> Motion:
    """Return the motion of a candidate, held against its limits on the records that will be sent.

    Args:
        candidate: from hold to hold, or from the state it takes over.
        request: what it was made for.
        start: where the device is commanded to be.
        limits: to keep.
        period: of the device, s.
        motion_id: names the motion.

    Raises:
        LimitError: it breaks one.
    """
    path = candidate.path
    count = math.ceil(path.duration / period - _END_SLACK) + 1

    # Between the records any motion may go up to the limits, a timing of the user's on them, too;
    # the guard's tolerance is all that is left to brake with there.
    core = candidate.keyframe_path
    known = None if core is None else core.found_as_whole(path, start, period, limits)
    peaks = known or measure_path(
        path,
        count,
        period,
        limits,
        before=before(start, period) if start.is_known else None,
        brake_limits=limits.scaled(GUARD_TOLERANCE),
        rough=candidate.rough,
    )
    place = refusal.Place(request, candidate.begin, candidate.end, candidate.keyframe_times)
    refusal.check_limits(peaks, place)
    refusal.check_stop(peaks, place)
    return Motion(
        id=motion_id,
        request=request,
        limits=limits,
        period=period,
        path=path,
        start_time=candidate.begin,
        end_time=candidate.end,
        keyframe_times=candidate.keyframe_times,
        record_count=count,
        certificate=summed_up(
            request,
            path,
            (candidate.begin, candidate.end),
            candidate.keyframe_times,
            peaks,
            period,
            limits,
        ),
        rough=candidate.rough,
        before=start.before,
    )
