"""Plan motions outside of keep-out cones: check them, and lead those that cross around.

The planner adds keyframes where the shortest path outside touches a cone.  It passes them on one
curve, as quickly as the limits permit.  The curve may swing into a cone between them, so keyframes
are moved outwards or added until the bounds of the whole motion keep clear.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from orientd.curves import METHODS, Trajectory
from orientd.errors import PlanError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certifying import certified
from orientd.planner.keep_out.clearance import Cones
from orientd.planner.keep_out.corners import (
    own,
    own_times,
    restored,
    with_corners,
    with_orientation,
)
from orientd.planner.keep_out.route import POINTS, Obstacle, keyframes_along, shortest_path
from orientd.planner.motion import Motion
from orientd.planner.path import Path
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, rotate

Planning = Callable[[MotionRequest], Motion]
"""Plans a request in the coordinates of the device, without regard to cones."""

RESERVE = math.radians(0.1)
"""Distance from an edge that a path around is made for, rad."""

_ROUNDS = 6  # plans until a curve keeps clear
_SAME = 1.0 - 1e-9  # cosine between an axis and the pointing axis
_EVERY = 4  # points of a path between two keyframes, if fewer do not keep clear
_EXIT = math.radians(2.0)  # distance from the edge of the first keyframe outside


@dataclass(slots=True, eq=False)
class Around:
    """Plan one request outside of cones.

    Attributes:
        cones: of the motion.
        start: the commanded state of the device.
        plan: plans without regard to cones.
        path_from: returns what plans from a state, without regard to cones and to the axes.
        follow: returns a motion on the path that the axes follow.
        is_turn: whether the request is a turn at a rate, which has no other route.
        has_slews: whether the axes slew rather than let the path wait for them.  Their slews then
            have led around already, as far as they can.
    """

    cones: Cones
    start: State
    plan: Planning
    path_from: Callable[[State], Planning]
    follow: Callable[[Motion], Motion] | None = None
    is_turn: bool = False
    has_slews: bool = False
    _margins: float = field(default=1.0, init=False)
    _is_roll_free: bool = field(default=False, init=False)
    _refused: str = field(default="", init=False)

    def motion(self, request: MotionRequest) -> Motion:
        """Return the requested motion outside of the cones, with their clearances certified.

        Args:
            request: in coordinates of the device.

        Raises:
            PlanError: a keyframe is inside a cone, there is no route around, or the motion cannot
                be planned.
        """
        motion = self.plan(replace(request, keep_out=()))
        self._is_roll_free = request.is_single and request.keyframes[0].free_roll
        turns = self.is_turn or any(keyframe.turns for keyframe in request.keyframes)
        # The planner divides turns by keyframes of its own.
        notes = [] if turns else self._check_keyframes(motion)
        direct = motion.request
        short = self._short(direct, motion)
        if float(short.min()) >= 0.0:
            return self.cones.certified(motion, request).noted(*notes)
        try:
            found = self._led(direct, motion, turns=turns)
        except PlanError:
            if not any(cone.margin for cone in self.cones.cones):
                raise
            notes.append(f"passes through the margin of {self._named(short)}")
            self._margins = 0.0
            is_outside = float(self._short(direct, motion).min()) >= 0.0
            found = motion if is_outside else self._led(direct, motion, turns=turns)
        return self.cones.certified(found, request).noted(*notes)

    def _short(self, request: MotionRequest, motion: Motion) -> Floats:
        """Return by how much a motion is clearer of each cone than it has to be, rad.

        It keeps out of a margin in legs whose ends are both outside of it.

        Returns:
            For each cone and interval between records, shape ``(cones, n - 1)``.
        """
        bounds = self.cones.bounds(motion)
        if not any(cone.margin for cone in self.cones.cones) or not self._margins:
            return bounds
        ends = own_times(request, motion)
        middles = motion.period * (np.arange(bounds.shape[1]) + 0.5)
        legs = np.searchsorted(ends, middles)
        mine = request.keys[own(request)]
        keys = np.array([self.start.q, *mine, mine[-1]])
        times = np.array([0.0, *ends, motion.duration])
        clear = self.cones.clearances(keys, times)
        for row, cone, at in zip(bounds, self.cones.cones, clear, strict=True):
            keeps = np.minimum(at[:-1], at[1:]) >= cone.margin + RESERVE
            keeps[-1] = False  # the lead-out follows from the velocity at its beginning
            row -= np.where(keeps[legs], cone.margin, 0.0)
        return bounds

    def _check_keyframes(self, motion: Motion) -> list[str]:
        """Return notes on keyframes in margins.

        Raises:
            PlanError: a keyframe is inside a cone.
        """
        request, notes = motion.request, []
        is_passed = METHODS[request.method].interpolates
        begins = not request.approach
        keys, times = request.keys, motion.keyframe_times
        clear = self.cones.clearances(keys, times)
        for cone, row in zip(self.cones.cones, clear, strict=True):
            for index, far in enumerate(row.tolist()):
                is_there = begins and index == 0
                if is_there or not (is_passed or index == len(keys) - 1):
                    continue
                if far < 0.0:
                    raise PlanError(
                        f"keyframes[{index}] is {math.degrees(-far):.3g} deg inside keep-out "
                        f"{cone.name}, whose half angle is {math.degrees(cone.half_angle):.4g} deg"
                    )
                if far < cone.margin:
                    notes.append(
                        f"keyframes[{index}] is in the margin of keep-out {cone.name}, "
                        f"{math.degrees(far):.3g} deg from its edge"
                    )
        return notes

    def _named(self, short: Floats) -> str:
        """Return the names of the cones that a motion crosses."""
        worst = short.min(axis=1)
        names = [one.name for one, far in zip(self.cones.cones, worst, strict=True) if far < 0.0]
        return "keep-out " + " and ".join(names)

    def _check_can_lead(
        self, request: MotionRequest, motion: Motion, short: Floats, names: str, *, turns: bool
    ) -> None:
        """Raise :class:`.PlanError` if the request has no other route that can be planned."""
        legs = self._legs(request, motion, short)
        if self.has_slews and (legs[0] == 0 or _is_off_path(motion, short)):
            raise PlanError(
                f"the axes would slew through {names}, and there is no way around; begin elsewhere "
                "or at another time"
            )
        if turns:
            raise PlanError(f"the turn crosses {names}: a turn has no other route")
        if request.device_options.get("home"):
            raise PlanError(f"the motion home crosses {names}; move the tool aside first")
        if legs[-1] == len(request.keyframes):
            raise PlanError(
                f"the motion ends with a velocity, and its lead-out enters {names}; "
                "end slower or further away"
            )
        if not METHODS[request.method].interpolates or request.options:
            raise PlanError(
                f"the motion crosses {names}; {request.method} with these options does not pass "
                "further keyframes around it: take the default method"
            )

    def _led(self, request: MotionRequest, motion: Motion, *, turns: bool) -> Motion:
        """Return a motion around the cones that a motion crosses.

        Raises:
            PlanError: there is none.
        """
        short = self._short(request, motion)
        names = self._named(short)
        self._check_can_lead(request, motion, short, names, turns=turns)
        if not request.is_single and self._legs(request, motion, short)[0] == 0:
            return self._led_in(request, names)
        for detour in self._detours(request, motion, short, names):
            found = self._cleared(detour)
            if found is not None:
                return found.noted(f"led around {names}")
        raise PlanError(
            f"the motion crosses {names}, and no motion around was found: {self._refused}"
        )

    def _led_in(self, request: MotionRequest, names: str) -> Motion:
        """Return the motion with a lead-in of its own around cones.

        Such a lead-in comes to rest on its way: at the first keyframe, or where its run-up begins.
        The motion to that rest is planned by itself, around the cones, and the rest follows it.

        Raises:
            PlanError: there is none.
        """
        try:
            rest = rest_in_lead_in(self.path_from(self.start)(request))
            to_rest = Around(self.cones, self.start, self.path_from(self.start), self.path_from)
            approach = to_rest.motion(approach_to(rest, request))
            cones = self.cones.later(approach.duration)
            from_rest = Around(cones, rest, self.path_from(rest), _no_lead)
            motion = after_approach(approach, from_rest.motion(request), self.start)
            if self.follow is not None:
                motion = self.follow(motion)
        except PlanError as error:
            raise PlanError(
                f"the lead-in crosses {names}, and none around was found: {error}; move to the "
                "first keyframe before"
            ) from error
        if not float(self.cones.bounds(motion).min()) >= 0.0:
            raise PlanError(f"the lead-in crosses {names} where the axes turn")
        return motion.noted(f"led around {names} to its first keyframe")

    def _legs(self, request: MotionRequest, motion: Motion, short: Floats) -> list[int]:
        """Return the legs in which a motion is inside a cone.

        A leg leads to a keyframe of the user: leg 0 from the state of the device to the first one.
        """
        middles = motion.period * (np.flatnonzero(short.min(axis=0) < 0.0) + 0.5)
        return sorted(set(np.searchsorted(own_times(request, motion), middles).tolist()))

    def _detours(
        self, request: MotionRequest, motion: Motion, short: Floats, names: str
    ) -> tuple[MotionRequest, MotionRequest]:
        """Return the request with few corners in each leg that enters a cone, and with many.

        Raises:
            PlanError: there is no route.
        """
        few: list[tuple[int, Floats]] = []
        many: list[tuple[int, Floats]] = []
        ends, keys = own_times(request, motion), request.keys
        owners = np.searchsorted(ends, motion.period * (np.arange(short.shape[1]) + 0.5))
        for leg in self._legs(request, motion, short):
            time = 0.0 if leg == 0 else float(ends[leg - 1])
            first, last = keys[leg - 1] if leg else self.start.q, keys[leg]
            exits = self._exits(first, time)
            first = exits[-1] if exits else first
            obstacles = self._obstacles(first, last, time)
            axis = obstacles[int(np.argmin(short[:, owners == leg].min(axis=1)))].axis
            points = rotate(last, "xyz".index(request.pointing_axis) == np.arange(3))
            is_free = self._is_roll_free and float(rotate(last, axis) @ points) > _SAME
            path = shortest_path(first, last, obstacles, axis, is_roll_free=is_free)
            if path is None:
                place = "the start" if leg == 0 else f"keyframes[{leg - 1}]"
                raise PlanError(
                    f"there is no route from {place} to keyframes[{leg}] outside of {names}"
                )
            # The curve finds its own way out of a cone, faster than by a keyframe at the edge.
            few += [(leg, one) for one in keyframes_along(path, obstacles)]
            many += [(leg, one) for one in (*exits, *path[_EVERY : POINTS - 1 : _EVERY])]
            if is_free:
                request = with_orientation(request, -1, path[-1])
        return with_corners(request, self.start, few), with_corners(request, self.start, many)

    def _exits(self, q: Floats, time: float) -> list[Floats]:
        """Return the orientation straight outside if the device is inside a cone."""
        inside = [one for one in self._edges(time) if _depth(q, one) > 0.0]
        for one in inside:
            q = one.pushed(q[None], one.depth(q[None]) + _EXIT)[0]
        return [q] if inside else []

    def _edges(self, time: float) -> list[Obstacle]:
        """Return the cones themselves at a path time."""
        axes: dict[tuple[float, ...], Floats] = {}
        return [
            Obstacle(
                axes.setdefault(cone.axis, np.array(cone.axis)),
                self.cones.directions(cone, np.array([time]))[0],
                cone.half_angle,
            )
            for cone in self.cones.cones
        ]

    def _obstacles(self, first: Floats, last: Floats, time: float) -> list[Obstacle]:
        """Return the cones with reserve and margin, as far as both ends are outside of these."""
        found = []
        for cone, edge in zip(self.cones.cones, self._edges(time), strict=True):
            more = RESERVE + self._margins * cone.margin
            nearest = -float(np.max(edge.depth(np.array([first, last]))))
            radius = edge.radius + min(more, max(nearest - 1e-7, 0.0))
            found.append(replace(edge, radius=radius))
        return found

    def _cleared(self, request: MotionRequest) -> Motion | None:
        """Return the motion of a request with corners moved or added until it keeps clear."""
        for _ in range(_ROUNDS):
            try:
                motion = self.plan(request)
            except PlanError as error:
                self._refused = str(error)
                return None
            short = self._short(request, motion)
            if float(short.min()) >= 0.0:
                return restored(motion, request)
            request = self._pushed(request, motion, short)
        self._refused = "the curve through further keyframes swings inside"
        return None

    def _pushed(self, request: MotionRequest, motion: Motion, short: Floats) -> MotionRequest:
        """Return the request with corners outwards of where its motion is inside a cone."""
        count, found = len(request.keyframes), request
        ends = motion.keyframe_times[-count:]
        added: list[tuple[int, Floats]] = []
        is_inside = short.min(axis=0) < 0.0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], is_inside.astype(int), [0]])))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            part = short[:, begin:end]
            cone, place = np.unravel_index(int(np.argmin(part)), part.shape)
            far = np.array([RESERVE - float(part[cone, place])])
            time = motion.period * (begin + int(place) + 0.5)
            one = self._edges(time)[int(cone)]
            k = int(np.searchsorted(ends, time))
            near = int(np.argmin(np.abs(ends - time)))
            # The state of the device stays, if that is the first keyframe.
            if near and request.keyframes[near].is_added:
                q = np.array(found.keyframes[near].q)[None]
                found = with_orientation(found, near, one.pushed(q, far)[0])
            else:
                q = motion.sample(np.array([time])).q
                added.append((min(k, count - 1), one.pushed(q, far)[0]))
        return with_corners(found, self.start, added)


def _no_lead(_: State) -> Planning:
    raise PlanError("its run-up crosses one too")


def _is_off_path(motion: Motion, short: Floats) -> bool:
    """Return whether a motion is inside a cone while its axes do not follow the path."""
    times = motion.period * np.flatnonzero(short.min(axis=0) < 0.0)
    return any(
        bool(np.any((times >= one.start - motion.period) & (times <= one.end)))
        for one in motion.certificate.losses
    )


def _depth(q: Floats, obstacle: Obstacle) -> float:
    return float(obstacle.depth(q[None])[0])


_AT_REST = 1e-6  # rad/s


def rest_in_lead_in(motion: Motion) -> State:
    """Return the last state at rest in the lead-in of a motion.

    Raises:
        PlanError: it has none.
    """
    count = round(motion.start_time / motion.period) + 1
    rows = motion.rows(0, min(count, motion.record_count))
    is_resting = np.linalg.norm(rows[:, 4:7], axis=1) <= _AT_REST
    is_resting[0] = False
    if not is_resting.any():
        raise PlanError("the lead-in does not rest on its way")
    row = rows[int(np.flatnonzero(is_resting)[-1])]
    return State.at_rest(row[:4], row[10:13])


def approach_to(rest: State, request: MotionRequest) -> MotionRequest:
    """Return the request of the motion from the device's state to a rest in its lead-in."""
    w, x, y, z = rest.q.tolist()
    a, b, c = rest.position.tolist()
    place = None if request.positions is None else (a, b, c)
    return MotionRequest([Keyframe((w, x, y, z), position=place)], limits=request.limits)


def after_approach(approach: Motion, motion: Motion, start: State) -> Motion:
    """Return a motion that begins at rest, after the motion that leads there.

    Args:
        approach: ends where *motion* begins.
        motion: with its certificate.
        start: the commanded state of the device.

    Raises:
        LimitError: they break a limit together.
    """
    if not (isinstance(approach.path, Path) and isinstance(motion.path, Path)):
        raise TypeError("approach and motion must be paths, not records of a device's axes")
    period = motion.period
    begin = period * math.ceil(approach.duration / period - 1e-9)
    first, then = approach.path, motion.path
    lead = first.positions
    if not lead.is_held:
        lead = lead.slowed(begin / first.duration)
    whole = KeyframePath(
        Trajectory.joined([first.trajectory.slowed(begin), then.trajectory.shifted(begin)]),
        then.positions.delayed(begin).after(lead),
        motion.keyframe_times + begin,
        motion.certificate.notes,
    )
    joined = certified(whole, motion.request, start, motion.limits, period, motion_id=motion.id)
    return joined.noted(*motion.certificate.notes)
