"""The input of a plan: request, start and limits, and the pieces made from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from orientd.curves.contract import METHODS
from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.errors import PlanError
from orientd.model.limits import LONGEST, Limits, is_still
from orientd.model.request import MotionRequest
from orientd.planner import refusal
from orientd.planner.connect.axis_leads import followed
from orientd.planner.connect.connector import hold, turn_to_stop
from orientd.planner.connect.leads import (
    LEAD_SHARE,
    MOST_SHARE,
    SAME_PLACE,
    Lead,
    approach,
    join_in,
    lead_in,
    lead_out,
    straight,
)
from orientd.planner.connect.position_stop import position_lead
from orientd.planner.errors import LeadError
from orientd.planner.methods import Ends, build, check_method
from orientd.planner.path import (
    PositionPath,
    end_states,
    position_path,
)
from orientd.planner.resolve import half_turn_notes
from orientd.planner.state import State
from orientd.planner.timing.axes import NO_AXES, Axes, AxisPath
from orientd.planner.timing.axes import SHARE as AXIS_SHARE
from orientd.planner.timing.axis_ways import Candidate, quickest_of, ways_along
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import Knots, chord_knots, quick_knots
from orientd.planner.timing.profiles import quickest
from orientd.rotation import Floats, angle

_HOPELESS = 1e3  # growth of the allowed duration with each keyframe
_END_SLACK = 1e-9  # of a period
_NEAR = 1.25  # multiple of the turn of a stop: nearer targets may be overshot
_WORTH = 0.95  # share of a duration that is worth going without the reserve

CALM_LEAD_SHARE = 0.75
"""The same where time is given, or the pace is even.

Stops are shorter for it, and the motion is not longer: leads are a small part of it.
"""

TAKE_OVER_SHARE = 0.985
"""The same for the lead-in of a motion that takes over from another one.

It is more than that of timings.  So a device that brakes as a timing does has room for a lead-in.
"""

WITHOUT_RESERVE = MOST_SHARE / TAKE_OVER_SHARE
"""Multiple of its usual share with which the lead-in of such a motion uses the largest one."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanJob:
    """The input of a plan, and the pieces of its motion.

    Attributes:
        request: the requested motion.
        own: the limits of the motion.
        ends: velocities at the first and last keyframe.
        halt: how a position without keyframes comes to rest.
        is_even: whether a lead-in from rest has an even pace.  It does if keyframes have times,
            since these require shorter stops.
        lead_share: share of acceleration and jerk that leads use.
        notes: notes of the certificate on the request.
        axes: of the device, if the timing regards them.
    """

    request: MotionRequest
    start: State
    limits: Limits
    own: Limits
    period: float
    ends: Ends
    halt: PositionPath
    is_even: bool
    lead_share: float
    notes: tuple[str, ...] = ()
    axes: Axes | None = None
    _leads: dict[tuple[bytes, float], Lead] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        request: MotionRequest,
        start: State,
        own: Limits,
        period: float,
        axes: Axes | None = None,
    ) -> PlanJob:
        """Check the request as far as possible without a curve."""
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
            # Every curve begins at its first keyframe with the requested velocity.  So a wrong
            # start shows without making one.
            omega = start.omega_body
            if family.meets_end_velocities:
                omega = np.zeros(3) if omega_start is None else omega_start
            first = replace(start, q=request.keys[0], omega_body=omega)
            refusal.check_start(start, first, limits)
        ends = Ends(omega_start, omega_end, alpha_start)
        notes = (*request.notes, *half_turn_notes(request, start))
        halt = position_lead(start, None, limits=limits, period=period)
        is_even = not request.is_quickest
        share = CALM_LEAD_SHARE if is_even or request.total is not None else LEAD_SHARE
        return cls(
            request, start, limits, own, period, ends, halt, is_even, share, notes=notes, axes=axes
        )

    def within(self, limits: Limits) -> PlanJob:
        """Return the same job within other limits."""
        return replace(self, limits=limits, _leads={})

    def with_quick_leads(self) -> PlanJob:
        """Return the same job with leads that are as short as if no time is given."""
        return replace(self, lead_share=LEAD_SHARE, _leads={})

    def share_from(self, state: State, multiple: float = 1.0) -> float:
        """Return the share of acceleration and jerk that a lead from a state may use.

        Args:
            state: where it begins.
            multiple: of the usual share.
        """
        takes_over = not (state.is_at_rest or self.start.is_at_rest)
        usual = TAKE_OVER_SHARE if takes_over else self.lead_share
        return min(multiple * usual, MOST_SHARE)

    def share_leaving(self, more: float, multiple: float) -> float:
        """Return the multiple of the usual share with which leads leave *more* times as much of it.

        Args:
            more: times what they leave of acceleration and jerk now.
            multiple: of the usual share that they use now.
        """
        return (1.0 - more * (1.0 - multiple * self.lead_share)) / self.lead_share

    def is_there(self, start: State, end: State) -> bool:
        """Return whether a state is at the place of another one, and the axes at their goal."""
        move = float(np.linalg.norm(end.position - start.position))
        is_same = max(float(angle(start.q, end.q)), move) <= SAME_PLACE
        return is_same and (self.axes is None or self.axes.is_at_goal)

    @property
    def is_taken_over(self) -> bool:
        """Whether a position continues a motion."""
        return self.start.is_position_moving and not self.request.approach

    @property
    def has_one_shape(self) -> bool:
        """Whether a different duration gives the same curve at another rate."""
        return not (self.is_taken_over or any(self.ends.moves))

    def knots(self, *, is_quick: bool) -> tuple[Knots, float]:
        """Return times for keyframes without times, and the approximate duration of the motion, s.

        Args:
            is_quick: whether to choose the fastest times.  The request's own limits apply, so the
                path is the same at any share of the pace.
        """
        if not is_quick:
            refusal.check_continuity(self.request)
        is_uniform = not METHODS[self.request.method].interpolates
        knots = chord_knots(self.request, self.limits, is_uniform=is_uniform)
        guess = knots.first_guess(self.limits.with_reserve())
        if self.has_one_shape and guess > _HOPELESS * len(knots.times) * LONGEST:
            refusal.check_duration(guess)
        states = (self.ends.omega_start, self.ends.omega_end)
        begin, end = (np.zeros(3) if omega is None else omega for omega in states)
        # At any ends the velocity changes by the integral of the acceleration.
        change = float(np.linalg.norm(end - begin)) / self.limits.acceleration
        guess = min(max(guess, change, 2.0 * self.period), LONGEST)
        if is_quick and self.has_one_shape and self.halt.is_held:
            knots = quick_knots(self.request, knots)
        return knots, guess

    def path(self, knots: Knots, duration: float, *, is_paced: bool = True) -> KeyframePath:
        """Return the path through the keyframes that takes *duration* seconds.

        Args:
            knots: times up to a factor.
            duration: s.
            is_paced: whether the path keeps its own pace; otherwise its pace is found afterwards.

        Raises:
            PlanError: the method has no curve through these keyframes, or the axes do not make it.
        """
        request, kept = self.request, knots.kept
        times = knots.times * (duration / knots.times[-1])
        times[-1] = duration
        can_rest = METHODS[request.method].meets_end_accelerations
        is_free = knots.leaves_freely or not (is_paced or can_rest)
        ends = replace(self.ends, leaves_freely=True) if is_free else self.ends
        curve = build(request, request.keys[kept], times[kept], request.turns[kept], ends)
        try:
            trajectory = curve.trajectory
        except ValueError as error:
            raise PlanError(f"{request.method} has no smooth curve here: {error}") from error
        if trajectory.domain != (0.0, duration):
            trajectory = trajectory.shifted(-trajectory.domain[0]).slowed(duration)
        positions, merged = self._positions(knots, times), knots.merged(request)
        path = KeyframePath(trajectory, positions, times, merged)
        if self.axes is None or not is_paced:
            return path
        return self.axes.made(path, partial(self.joints_at, path.first))

    def _positions(self, knots: Knots, times: Floats) -> PositionPath:
        asked, start, kept = self.request.positions, self.start, knots.kept
        given = asked
        if asked is not None and len(kept) < len(asked):
            # Times of the kept keyframes, or of their repetitions.
            given = asked[kept]
            owners = np.searchsorted(kept, np.arange(len(asked)), side="right") - 1
            for index in np.flatnonzero(np.isfinite(asked[:, 0])):
                if not np.isfinite(given[owners[index], 0]):
                    given[owners[index]] = asked[index]
        if not self.is_taken_over:
            return position_path(times[kept], given, self.halt.last)
        points = np.empty((0, 3)) if given is None else given[np.isfinite(given[:, 0])]
        if len(points) < 2:
            target = points[0] if len(points) else None
            return position_lead(start, target, limits=self.limits, period=self.period)
        first = start.position, start.velocity, start.acceleration
        return position_path(times[kept], given, self.halt.last, first)

    def lead_to(self, first: State, share: float = 1.0) -> Lead:
        """Return the lead-in to a state at the first keyframe.

        Args:
            first: the state.
            share: multiple of the usual share of acceleration and jerk.

        Raises:
            PlanError: it takes longer than the longest allowed motion.
        """
        rates = first.q.tobytes() + first.omega_body.tobytes() + first.alpha_body.tobytes()
        lead = self._leads.get((rates, share))
        if lead is None:
            is_moving = not is_still(first.omega_body, first.alpha_body, self.limits)
            if self.request.is_single:
                is_there = bool((first.position == self.start.position).all())
                is_direct = is_moving or self.is_even or is_there
            else:
                # A position arrives with the approach and waits during the run-up.
                is_direct = is_moving and not self.is_even and self.request.positions is None
            find = partial(self.connected, self.start, first, is_direct=is_direct)
            lead = find(share=share)
            near = _NEAR * turn_to_stop(self.start, self.limits)
            is_usual = self.request.is_single and share == 1.0
            if is_usual and float(angle(self.start.q, first.q)) < near:
                # A motion that brakes at the full limits overshoots with reduced ones.
                full = find(share=WITHOUT_RESERVE)
                lead = full if full.cycles < _WORTH * lead.cycles else lead
            self._leads[rates, share] = lead
        return lead

    def connected(
        self,
        start: State,
        end: State,
        *,
        is_direct: bool = True,
        share: float = 1.0,
        least: float = 0.0,
        near: Joints = (),
    ) -> Lead:
        """Return the lead-in from one state to another.

        Args:
            start: initial state.
            end: final state.
            is_direct: whether to prefer a connector to a run-up from rest.
            share: multiple of the usual share of acceleration and jerk.
            least: least duration of a connector, s.
            near: axis angles at the initial state, rad; by default those of the device's start.

        Raises:
            PlanError: no lead-in keeps the limits.
        """
        find = partial(
            self._lead_of_tool, start, end, is_direct=is_direct, share=share, least=least
        )
        if self.axes is None:
            return find()
        near, refusal = near or self.axes.joints, None
        is_rested = start.is_at_rest and is_still(end.omega_body, end.alpha_body, self.limits)
        if is_rested and not self.is_there(start, end):
            try:
                return self._straight_lead(start, end, near)
            except PlanError as error:
                # The lead of the tool alone turns and moves at paces of their own, and may pass.
                refusal = error
        try:
            return followed(
                lambda pace: find(pace=pace),
                self.axes,
                near,
                self.limits,
                self.period,
                has_one_way=is_rested,
            )
        except PlanError as error:
            raise refusal or error from None

    def _lead_of_tool(
        self,
        start: State,
        end: State,
        *,
        is_direct: bool,
        share: float,
        least: float,
        pace: float = 1.0,
    ) -> Lead:
        """Return the lead-in of the tool alone, at a share of its pace."""
        limits, own = self.limits, self.own
        if pace < 1.0:
            limits, own = limits.slowed(pace), own.slowed(pace)
        find = partial(
            lead_in, start, end, limits=limits, own=own, period=self.period,
            share=self.share_from(start, share), is_even=self.is_even, least=least,
        )  # fmt: skip
        try:
            return find(is_direct=is_direct)
        except PlanError:
            if is_direct or not start.is_at_rest:
                raise
            # A run-up from rest may overshoot the velocity.
            return find(is_direct=True)

    def straight(
        self,
        start: State,
        end: State,
        near: Joints = (),
        *,
        is_part: bool = True,
        has_shape: bool = True,
    ) -> tuple[KeyframePath, Joints]:
        """Return the fastest straight way from rest to rest, and the axes at its end.

        Args:
            start: initial state.
            end: final state; the way takes no time if it is at the same place.
            near: axis angles at its start, rad; by default those of the device's start.
            is_part: whether it is part of a longer motion.
            has_shape: as for :func:`.ways_along`.

        Raises:
            PlanError: the axes do not reach it, or the limits allow no timing.
        """
        near = near or (self.axes.joints if self.axes is not None else ())
        is_held = np.linalg.norm(end.position - start.position) <= SAME_PLACE
        if self.is_there(start, end) or (self.axes is None and is_held):
            turn = approach(start.q, end.q, self.limits, is_part=is_part) or hold(start.q, 0.0)
            held = PositionPath.held(start.position)
            return KeyframePath(turn, held, np.array([0.0, turn.duration])), near
        path, share = straight(start, end), min(self.lead_share / LEAD_SHARE, 1.0)
        within = self.limits.with_reserve(share)
        if self.axes is None:
            return quickest(path, within, self.period, has_rests=True), near
        ways = ways_along(
            self.axes, path, near, within, self.period, share=share * AXIS_SHARE,
            has_shape=has_shape,
        )  # fmt: skip
        return quickest_of(ways, within, self.period)

    def _straight_lead(self, start: State, end: State, near: Joints) -> Lead:
        """Return the straight way from rest to rest elsewhere as a lead-in."""
        path, joints = self.straight(start, end, near, has_shape=False)
        cycles = math.ceil(path.duration / self.period - _END_SLACK)
        path = path.slowed(cycles * self.period)
        return Lead((path.trajectory,), cycles, path.positions, joints, path.slews)

    def ways_along(self, path: KeyframePath) -> list[Candidate]:
        """Return the ways of the device along a path through the keyframes.

        Raises:
            PlanError: the axes do not reach a pose, or the limits allow no lead-in.
        """
        if self.axes is None:
            return [(1.0, path, NO_AXES)]
        near, place = self.joints_at(path.first), partial(refusal.between, self.request, path.times)
        return ways_along(self.axes, path, near, self.limits, self.period, place=place)

    def axes_along(self, path: KeyframePath) -> AxisPath:
        """Return the axes along a path through the keyframes, if the timing regards them.

        Raises:
            PlanError: the axes do not reach a pose, or the limits allow no lead-in.
        """
        if self.axes is None:
            return NO_AXES
        near, place = self.joints_at(path.first), partial(refusal.between, self.request, path.times)
        return self.axes.along(path, near, self.limits, self.period, place=place)

    def joints_at(self, first: State) -> Joints:
        """Return the axis angles at the first keyframe, rad; none if the timing disregards them.

        Raises:
            PlanError: the limits allow no lead-in.
        """
        if self.axes is None or not self.request.approach:
            return () if self.axes is None else self.axes.joints
        return self.lead_to(State.at_rest(first.q, first.position)).joints

    def stop_from(self, state: State, near: Joints, share: float) -> Lead:
        """Return the lead-out from a moving state to rest.

        Args:
            state: its position is at rest.
            near: axis angles there, rad; none if the timing disregards them.
            share: of acceleration and jerk.

        Raises:
            PlanError: none keeps the limits.
        """

        def lead(pace: float) -> Lead:
            within = self.limits.slowed(pace) if pace < 1.0 else self.limits
            found = lead_out(state, limits=within, period=self.period, share=share)
            held = PositionPath.held(state.position)
            return Lead((found,), round(found.duration / self.period), held)

        if self.axes is None:
            return lead(1.0)
        return followed(lead, self.axes, near, self.limits, self.period)

    def leads_out(
        self, last: State, end: float, share: float, near: Callable[[], Joints]
    ) -> list[Trajectory]:
        """Return the lead-out from a state at a path time; empty if it is at rest.

        Args:
            last: the state.
            end: the path time, s.
            share: multiple of the usual share of acceleration and jerk.
            near: returns the axis angles there, rad.

        Raises:
            LeadError: no lead-out keeps the limits.
        """
        if is_still(last.omega_body, last.alpha_body, self.limits):
            return []
        try:
            used = min(share * self.lead_share, MOST_SHARE)
            parts = self.stop_from(last, near(), used).parts
        except PlanError as error:
            raise LeadError(f"no lead-out from the last keyframe: {error}") from error
        return [one.shifted(end) for one in parts]

    def with_leads(self, path: KeyframePath | State, share: float = 1.0) -> KeyframePath:
        """Return the whole path around a keyframe path, from rest to rest.

        The lead-in comes first.  A lead-out follows if the keyframe path does not end at rest.

        Args:
            path: from the first keyframe to the last; or the state at a single one, or all of the
                way to it.
            share: multiple of the usual share of acceleration and jerk, for the leads.

        Raises:
            StartError: there is no lead-in, and the keyframe path begins elsewhere.
            PlanError: no lead keeps the limits.
        """
        if self.request.is_single and not isinstance(path, State):
            return path
        first = path if isinstance(path, State) else path.first
        lead = self.lead_to(first, share) if self.request.approach else None
        parts = [] if lead is None else [*lead.parts]
        begin = 0.0 if lead is None else lead.cycles * self.period
        if isinstance(path, State):
            if lead is None:
                raise ValueError("a single keyframe needs a lead-in")
            parts += self.leads_out(path, begin, share, lambda: lead.joints)
            whole, times = Trajectory.joined(parts), np.array([begin])
            return KeyframePath(whole, lead.positions, times, slews=lead.slews)
        core, positions, notes = path.trajectory, path.positions, path.notes
        if lead is not None:
            positions = positions.delayed(begin).after(lead.positions)
        else:
            joint = self._joint(path)
            if joint is not None:
                parts.append(joint)
                core = core.restricted(joint.duration, core.duration)
                if self.start.is_at_rest:
                    notes += (
                        f"joins the curve {joint.duration:.3g} s after keyframes[0]: "
                        f"{self.request.method} does not begin at rest",
                    )
        parts.append(core.shifted(begin) if begin else core)
        last, place = end_states(path.trajectory)[1], path.positions.last
        last = State(last.q, last.omega_body, last.alpha_body, place)
        end = begin + path.duration
        parts += self.leads_out(last, end, share, lambda: self.axes_along(path).end)
        times, whole = path.times + begin, Trajectory.joined(parts)
        slews = () if lead is None else lead.slews
        slews += tuple(one.moved(partial(np.add, begin)) for one in path.slews)
        return KeyframePath(whole, positions, times, notes, path.missed, slews)

    def _joint(self, path: KeyframePath) -> Trajectory | None:
        """Return the lead-in to a path that begins here; ``None`` if it needs none."""
        start, (first, _) = self.start, end_states(path.trajectory)
        place = path.positions.state(0.0)
        here = State(first.q, first.omega_body, first.alpha_body, *place)
        if not refusal.differences(start, here, self.limits):
            return None
        # A requested velocity was checked before.  The method does not begin with that of the
        # device, or not with its acceleration.
        rates = start.omega_body, start.alpha_body
        refusal.check_start(start, State(first.q, *rates, *place), self.limits)
        share = self.share_from(start)
        return join_in(path, start, limits=self.limits, period=self.period, share=share)
