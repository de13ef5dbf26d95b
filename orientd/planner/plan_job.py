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
from orientd.planner.candidate import CandidateMotion, leads_out, with_leads
from orientd.planner.certify import before, measure, summed_up
from orientd.planner.connect import (
    CONNECTIONS,
    USUAL,
    Connection,
    LeadIn,
    lead_in,
    position_lead,
)
from orientd.planner.limits import LONGEST, Limits, is_still
from orientd.planner.methods import Ends, can_turn, check_method
from orientd.planner.motion import Motion
from orientd.planner.path import PositionPath, end_states
from orientd.planner.request import MotionRequest, State
from orientd.planner.resolve import half_turn_notes
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


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The curve of keyframes without times, in about its duration.

    Attributes:
        path_request: what it is made from.
        path: the curve.
        profile: its first profile, if one is known.
        has_chosen_times: whether its times were chosen for the quickest way.
    """

    path_request: PathRequest
    path: KeyframePath
    profile: FirstProfile | None
    has_chosen_times: bool


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
        halt: how a position comes to rest that no keyframe asks for.
        is_even: whether the way from rest to the first keyframe keeps the reserve of an even pace,
            as it does where keyframes have times: these ask for stops that take less time.
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
    halt: PositionPath
    is_even: bool
    notes: tuple[str, ...] = ()
    merged: list[str] = field(default_factory=list)
    offset: int = 0
    _leads: dict[tuple[Connection, bytes], LeadIn] = field(default_factory=dict)
    _shapes: dict[bool, Shape] = field(default_factory=dict)

    @classmethod
    def of(cls, request: MotionRequest, start: State, own: Limits, period: float) -> PlanJob:
        """Check what can be checked before a curve is made."""
        limits = own.slowed(request.pace) if isinstance(request.pace, float | int) else own
        limits = limits.at_period(period)
        family = check_method(request)
        if request.limits is not None:
            refusal.check_present_rates(start, own, period)
        omega_start, omega_end = request.omega_start, request.omega_end
        alpha_start = None
        if not start.is_at_rest and not request.approach:
            # The motion takes over from another one that is still moving.
            if family.meets_end_velocities and omega_start is None:
                omega_start = start.omega_body
            if family.meets_end_accelerations:
                alpha_start = start.alpha_body
        refusal.check_end_velocities(omega_start, omega_end, limits)
        if not request.approach:
            # Every curve begins at its first keyframe, with the velocity that was asked for: none
            # need be made to see that the device is elsewhere.
            omega = start.omega_body
            if family.meets_end_velocities:
                omega = np.zeros(3) if omega_start is None else omega_start
            first = replace(start, q=request.keys[0], omega_body=omega)
            refusal.check_start(start, first, limits)
        ends = Ends(omega_start, omega_end, alpha_start)
        has_turns = can_turn(family) or request.is_single
        notes = (*request.notes, *half_turn_notes(request, start, has_turns=has_turns))
        halt = position_lead(start, None, limits=limits, period=period)
        is_even = not request.is_quickest
        return cls(request, start, limits, own, period, ends, halt, is_even, notes=notes)

    def evenly(self) -> PlanJob:
        """Return the same job, to be done at an even pace."""
        return self if self.is_even else replace(self, is_even=True, _leads={})

    def of_part(self, request: MotionRequest, start: State, offset: int) -> PlanJob:
        """Return the job of a part of the motion, from rest to rest.

        Args:
            request: the keyframes of the part.
            start: at rest at the first of them.
            offset: the index of that keyframe in the request.
        """
        halt = PositionPath.held(start.position)
        return PlanJob(
            request, start, self.limits, self.own, self.period, Ends(), halt, self.is_even,
            offset=offset,
        )  # fmt: skip

    @property
    def has_one_shape(self) -> bool:
        """Whether another duration is the same curve at another rate."""
        is_taken_over = self.start.is_position_moving and not self.request.approach
        return not (is_taken_over or any(self.ends.moves))

    @property
    def is_led_by_connector(self) -> bool:
        """Whether the lead-in goes from a motion, or to one."""
        is_moving = self.request.is_single or self.ends.moves[0] or not self.start.is_at_rest
        return self.request.approach and is_moving

    def shape(self, *, is_quick: bool) -> Shape:
        """Return the curve of keyframes without times.

        Args:
            is_quick: whether to choose times for the quickest way, by the own limits so that the
                path is the same at any share of its pace.
        """
        if is_quick not in self._shapes:
            self._shapes[is_quick] = self._shape(is_quick=is_quick)
        return self._shapes[is_quick]

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
        return Shape(path_request, make(guess), profile, chosen is not None)

    def path_request(self, times: Floats, kept: Indices) -> PathRequest:
        """Return what the keyframe path through the *kept* keyframes is made from."""
        start, given, halt = self.start, self.request.positions, self.halt
        if given is not None and not self.request.approach:
            only = given[np.flatnonzero(np.isfinite(given[:, 0]))[0]]
            halt = position_lead(start, only, limits=self.limits, period=self.period)
        is_taken_over = start.is_position_moving and not self.request.approach
        first = (start.position, start.velocity, start.acceleration) if is_taken_over else None
        return PathRequest(self.request, self.ends, times, kept, halt, first)

    def moving(self, path_request: PathRequest, duration: float) -> KeyframePath:
        """Return one of many keyframe paths to try, each of which may be hard to find."""
        return path_request.keyframe_path(duration)

    def lead_to(self, first: State, connection: Connection = USUAL) -> LeadIn:
        """Return the lead-in to a state at the first keyframe.

        Raises:
            PlanError: none was found.
        """
        rates = first.q.tobytes() + first.omega_body.tobytes() + first.alpha_body.tobytes()
        lead = self._leads.get((connection, rates))
        if lead is None:
            is_moving = not is_still(first.omega_body, first.alpha_body, self.limits)
            if self.request.is_single:
                is_there = bool((first.position == self.start.position).all())
                is_direct = is_moving or self.is_even or is_there
            else:
                # A position arrives with the approach and waits during the run-up.
                is_direct = is_moving and not self.is_even and self.request.positions is None
            lead = self.connected(self.start, first, connection, is_direct=is_direct)
            self._leads[connection, rates] = lead
        return lead

    def connected(
        self, start: State, end: State, connection: Connection = USUAL, *, is_direct: bool = True
    ) -> LeadIn:
        """Return the way from one state to another.

        Args:
            start: where it begins.
            end: where it ends.
            connection: how to connect a motion.
            is_direct: whether a connector is preferred to a run-up where it begins at rest.

        Raises:
            PlanError: none was found.
        """
        find = partial(
            lead_in,
            start,
            end,
            limits=self.limits,
            own=self.own,
            period=self.period,
            connection=connection,
            is_even=self.is_even,
        )
        try:
            return find(is_direct=is_direct)
        except PlanError:
            if not start.is_at_rest:
                raise
            return find(is_direct=not is_direct)

    def leads_from(self, path: KeyframePath) -> KeyframePath:
        """Return a path unchanged, if there is a lead-out from its end.

        Raises:
            PlanError: no lead-out keeps the limits.
        """
        leads_out(end_states(path.trajectory)[1], path.duration, self.limits, self.period)
        return path

    def leads_to(self, path: KeyframePath) -> KeyframePath:
        """Return a path unchanged, if there are leads to it and from it.

        Raises:
            PlanError: no lead keeps the limits.
        """
        if self.request.approach:
            self.lead_to(_first_state(path))
        return self.leads_from(path)

    def with_leads(self, path: KeyframePath, lead: LeadIn | None) -> CandidateMotion:
        """Return the path from hold to hold around a keyframe path."""
        return with_leads(path, lead, self.start, self.limits, self.period)

    def motion(self, path: KeyframePath, name: str, merged: Sequence[str] | None = None) -> Motion:
        """Return the motion along a keyframe path, led in and out, certified.

        Args:
            path: from the first keyframe to the last.
            name: of the motion.
            merged: what to say of merged keyframes in place of what the job says.

        Raises:
            StartError: there is no lead-in, and the path begins elsewhere.
            LimitError: it breaks a limit.
            PlanError: no lead keeps the limits.
        """
        return self.led(_first_state(path), partial(self.with_leads, path), name, merged)

    def led(
        self,
        first: State,
        candidate: Callable[[LeadIn | None], CandidateMotion],
        name: str,
        merged: Sequence[str] | None = None,
        connections: Sequence[Connection] = CONNECTIONS,
    ) -> Motion:
        """Return the motion behind the first lead-in with which it keeps its limits, certified.

        Args:
            first: where the lead-in leads to.
            candidate: makes the whole motion with a lead-in, if the request asks for one.
            name: of the motion.
            merged: what to say of merged keyframes in place of what the job says.
            connections: to try, one after the other, with a motion.

        Raises:
            LimitError: the motion breaks a limit, in its lead-in with every one of them.
            PlanError: no lead keeps the limits.
        """
        refused: LimitError | None = None
        for connection in connections if self.is_led_by_connector else (USUAL,):
            lead = self.lead_to(first, connection) if self.request.approach else None
            try:
                motion = self.certified(candidate(lead), name, merged)
            except LimitError as error:
                if not error.is_in_lead_in:
                    raise
                refused = refused or error
            else:
                note = f"led in by {connection.name}: with {USUAL.name} {refused}"
                return motion if refused is None else motion.noted(note)
        raise refused or PlanError("no lead-in was tried")

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


def _first_state(path: KeyframePath) -> State:
    first, _ = end_states(path.trajectory)
    return replace(first, position=path.positions.first)


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
    peaks = known or measure(
        path,
        count,
        period,
        limits,
        before=before(start, period) if start.is_known else None,
        tolerance=GUARD_TOLERANCE,
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
        ),
        rough=candidate.rough,
        before=start.before,
    )
