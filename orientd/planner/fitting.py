"""Plans on the path that the axes of a gimbal can follow, as fast as the axes allow.

A motion from rest away from the poles is timed for the tool and the axes at once, as the motions of
all other devices are.

Other motions are planned for the tool first.  If the axes cannot follow a path and the user set no
times, the motion slows down where an axis needs it.  If that does not fit, the whole motion is
planned again at a lower speed.  A bisection then finds nearly the highest speed that the axes
allow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from orientd.driver import AxisLimits, Joints
from orientd.errors import LimitError, LimitKind, PlanError, StartError
from orientd.mechanism import Gimbal
from orientd.mechanism.arrays import matrices, orientations, outer_line
from orientd.mechanism.gimbal_route import pointing_error
from orientd.mechanism.joint_path import JointPath, ToolLimits
from orientd.mechanism.keep_out_slews import Clearance
from orientd.mechanism.pacing import pace
from orientd.mechanism.routing import joints_along, route, route_at_times
from orientd.mechanism.turning import together
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner.certify.measuring import AxisRecords
from orientd.planner.job import certificate_of
from orientd.planner.motion import Motion
from orientd.planner.path import SAME_ANGLE, Path, RecordedPath
from orientd.planner.planning import plan
from orientd.planner.refusal import POWERS, check_total
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.rotation import Floats, angle

_STEP = 0.8
_SLOWEST = 0.1
"""Share of the device's speed below which no motion is slowed down for its axes."""
_SHARES = (0.8, 0.5)
"""Usable share of the accelerations for a nearly constant pace; less leaves more for changes."""
_BEYOND = 0.1
"""How far beyond a lead-in the search for its pace looks, s."""
_FINEST, _FINEST_OF_LEAD, _MOST_SAMPLES = 16, 64, 40_000
"""Samples per cycle and in total of the search for a pace: near a pole axes turn quickly.

A lead-in to times of the user is short and may pass very close to the pole.
"""
_LONG = 1.5
"""Factor of the duration beyond which the planner tries to slow down the whole motion instead."""
_HARDLY = 1.01
"""Factor of the duration up to which no note says that the axes slow the motion down."""
_FAR_FROM_POLE = 0.25
"""Sine of the distance from its poles beyond which a gimbal is timed for tool and axes at once."""
_DETOUR = 2.0
"""Factor of the time of the axes' turn together beyond which they turn together.

If the device rests and its path may have slews, the quicker one counts.
"""
_CLOSE = 1.02
"""Ratio at which the bisection between refused and feasible speed ends."""
_GIVEN = 0.2
"""How long after it takes over from a motion its speed is that motion's, s."""
_NEAR = 1e-3
"""Distance of the poses on both sides of a record that give the axis velocities there, periods."""
_ATTEMPTS = 16
"""Most plans of one request: each costs as much as the first."""


@dataclass(frozen=True, slots=True, eq=False)
class Fitting:
    """Planner for a gimbal, on the path that its axes follow.

    Attributes:
        gimbal: kinematics and limits of the axes.
        start: the commanded state of the device.
        joints: axis angles there, rad.
        limits: the device's.
        period: the device's cycle, s.
        before: planned axis angles of the previous cycles, if it moves, oldest first; see
            :meth:`.RecordedMotion.joints_before`.
        rates: planned axis velocities there, rad/s.
        motion_id: identifier of the motion; by default a new random one.
        free: path time up to which the path may stand while an axis turns at a pole, s.
        keep_out: as for :func:`.route_at_times`.
    """

    gimbal: Gimbal
    start: State
    joints: Joints
    limits: Limits
    period: float
    before: Sequence[Joints] = ()
    rates: Joints = ()
    motion_id: str | None = None
    free: float = 0.0
    keep_out: tuple[Clearance, ...] = ()

    def plan(self, request: MotionRequest) -> Motion:
        """Return the requested motion on the path that the device's axes follow.

        Raises:
            RequestError: its method or the device does not allow the request.
            PlanError: it cannot be planned, an axis cannot follow, or it would break a limit.
        """
        home = self.by_way(request)
        if home is not None:
            return home
        motion = self.planned(request)
        at_once = self._at_once(request, motion)
        if at_once is not None:
            return at_once
        try:
            found = self.followed(motion)
        except PlanError as error:
            refusal = error
        else:
            return self._without_detour(motion, found)
        # The plan has chosen the free roll.
        way = self.by_way(motion.request, refusal)
        if way is not None:
            return way
        # A motion with times of the user may stand only before its first keyframe.
        free = math.inf if request.times is None else motion.start_time
        is_later = isinstance(refusal, LimitError) and refusal.time > free
        if free > 0.0 and not is_later and not self._keeps_times(motion):
            with suppress(PlanError):
                return replace(self, free=free).followed(motion)
        raise refusal

    def _at_once(self, request: MotionRequest, tool: Motion) -> Motion | None:
        """Return the motion that is timed for tool and axes at once, if they can follow it.

        Near a pole the axes may leave its path.

        Args:
            tool: the motion for the tool alone.
        """
        is_moving, is_timed = not self.start.is_at_rest, request.times is not None
        if not self.joints or is_moving or is_timed or self._is_near_pole(tool):
            return None
        try:
            found = self.fitted(
                self.planned(request, Axes(self.gimbal, self.joints, is_recorded=False))
            )
        except PlanError:
            # The tool's own lead-in may pass elsewhere, where the axes can.
            return None
        longer = found.duration / tool.duration
        return found.noted(_slower(longer)) if longer > _HARDLY else found

    def _is_near_pole(self, tool: Motion) -> bool:
        """Return whether a motion of the tool comes near a pole."""
        times = tool.period * np.arange(tool.record_count, dtype=np.float64)
        _, distance = outer_line(self.gimbal, matrices(self.gimbal, tool.sample(times).q))
        return self.gimbal.is_pointing or float(np.min(distance)) < _FAR_FROM_POLE

    def _without_detour(self, motion: Motion, found: Motion) -> Motion:
        """Return the turn of all axes together if the path of *motion* takes them longer.

        On the shortest turn of the tool an axis may have to unwind, or to stop often for slews.

        Raises:
            PlanError: it takes much longer, and the device moves: the axes turn together from rest.
        """
        if found.duration < _LONG * motion.duration:
            return found
        is_moving = not self.start.is_at_rest
        here = State.at_rest(self.start.q, self.start.position)
        reason = PlanError(f"it would take the axes {found.duration:.1f} s")
        way = None
        with suppress(PlanError):
            way = replace(self, start=here, before=(), rates=()).by_way(motion.request, reason)
        least = 1.0 if self.gimbal.allow_slews and not is_moving else _DETOUR
        if way is None or least * way.duration > found.duration:
            return found
        if is_moving:
            raise PlanError("the axes turn together from rest only; stop first")
        return way

    def planned(self, request: MotionRequest, axes: Axes | None = None) -> Motion:
        """Return the requested motion; with *axes* its timing regards them."""
        return plan(
            request,
            start=self.start,
            limits=self.limits,
            period=self.period,
            motion_id=self.motion_id,
            axes=axes,
        )

    def followed(self, motion: Motion) -> Motion:
        """Return *motion* with the axes on its path, or raise :class:`.PlanError`."""
        try:
            found = self.fitted(motion)
            if found.duration > _LONG * motion.duration and motion.request.times is None:
                # Slews may take longer than a pace that suits the axes.
                with suppress(PlanError):
                    paced = self._paced(motion)
                    if paced is not None and paced.duration < found.duration:
                        return paced
            return found
        except LimitError as error:
            if error.kind is LimitKind.RANGE or self._keeps_times(motion):
                raise
            is_fixed = motion.request.times is not None or error.kind not in POWERS
            # A pace cannot change the state that the previous motion leaves.  Searching for a later
            # pace would take too long.
            is_given = not self.start.is_at_rest and error.time < _GIVEN and not is_fixed
            outside: LimitError | None = None
            try:
                paced = None if is_given else self._paced(motion)
            except LimitError as error_of_pace:
                if is_fixed or error_of_pace.kind is not LimitKind.RANGE:
                    raise
                paced, outside = None, error_of_pace
            if paced is not None and (is_fixed or paced.duration < _LONG * motion.duration):
                return paced
            if is_fixed:
                raise
            refusal = error
        # A pace keeps exactly to the path.  If the axes may deviate from it, a uniformly slower
        # motion can be faster.
        least = _SLOWEST if paced is None else max(_SLOWEST, motion.duration / paced.duration)
        try:
            evenly = self._slowed(motion, refusal, least)
        except PlanError:
            if paced is None:
                # If the axes reach an end of its range at any speed, report that.
                raise (outside or refusal) from None
            return paced
        return evenly if paced is None or evenly.duration < paced.duration else paced

    def _slowed(self, motion: Motion, refusal: LimitError, least: float) -> Motion:
        """Return *motion* planned with a lower share of the device's speed, at least *least*."""
        own, speed, worst = motion.limits, 1.0, refusal
        fitted: Motion | None = None
        refused, fits = 1.0, 0.0
        for _ in range(_ATTEMPTS):
            if fitted is None:
                need = (worst.limit / worst.value) ** (1.0 / POWERS[worst.kind])
                speed *= max(min(need, _STEP), 0.5)
                if speed < least:
                    raise refusal
            elif refused > _CLOSE * fits:
                speed = math.sqrt(refused * fits)
            else:
                break
            try:
                slower = replace(self, limits=own.slowed(speed), motion_id=motion.id)
                slow = slower.planned(motion.request)
                # Certified against the full limits: only the planning used lower ones.
                faster = self.fitted(replace(slow, limits=own))
            except PlanError as error:
                refused = speed
                if fitted is None:
                    if not isinstance(error, LimitError) or error.kind not in POWERS:
                        raise refusal from error
                    worst = error
                continue
            fits = speed
            if fitted is None or faster.duration < fitted.duration:
                fitted = faster
        if fitted is None:
            raise refusal
        return fitted.noted(_slower(fitted.duration / motion.duration))

    def _paced(self, motion: Motion) -> Motion | None:
        """Return *motion* at the pace that suits the axes, if that fits.

        Raises the refusal if the user set the times and the axes cannot follow, or if an axis
        reaches the end of its range.
        """
        period = motion.period
        refusal: PlanError | None = None
        is_timed = motion.request.times is not None
        for share in _SHARES:
            try:
                path_times = self._path_times(motion, share)
                if not len(path_times):
                    return None
                path = self._routed(motion, path_times)
                cycles = period * np.arange(len(path_times), dtype=np.float64)
                along = np.interp(path.path_times, cycles, path_times)
                longer = (len(path_times) - 1) * period / motion.duration
                notes = *path.notes, _slower(longer)
                return self._reshaped(motion, replace(path, path_times=along, notes=notes))
            except PlanError as error:
                if refusal is None and is_timed:
                    # The pace tells how much time is missing.
                    fixed = (motion.start_time, motion.end_time)
                    self._pace(motion, fixed, fixed, _SHARES[-1])
                refusal = refusal or error
                if isinstance(error, LimitError) and error.kind is LimitKind.RANGE:
                    refusal = error  # no pace changes that
                    break
        is_range = isinstance(refusal, LimitError) and refusal.kind is LimitKind.RANGE
        if refusal is not None and (is_timed or is_range):
            raise refusal
        return None

    def _path_times(self, motion: Motion, share: float) -> Floats:
        """Return the path times of *motion* by cycle; it slows down only without user times."""
        period, end = motion.period, motion.duration
        if motion.request.times is None:
            return self._pace(motion, (0.0, end), (math.inf, -math.inf), share)
        # Times of the user leave the lead-in free; from the first keyframe on they hold.
        begin = motion.start_time
        lead = np.zeros(1)
        if begin > 0.0:
            after = min(end, begin + _BEYOND)
            lead = self._pace(motion, (0.0, after), (begin, after), share, is_lead=True)
            lead = lead[lead <= begin]
        if not len(lead):
            return lead
        rest = np.arange(lead[-1] + period, end, period)
        return np.concatenate([lead, rest, [end]])

    def _pace(
        self,
        motion: Motion,
        span: tuple[float, float],
        fixed: tuple[float, float],
        share: float,
        *,
        is_lead: bool = False,
    ) -> Floats:
        """Return the path times of the pace that the axes need for *span*."""
        gimbal, period, (begin, end) = self.gimbal, motion.period, span
        cycles = math.ceil((end - begin) / period - 1e-9)
        finest = _FINEST_OF_LEAD if is_lead else _FINEST
        finest = min(finest, max(1, _MOST_SAMPLES // (cycles + 1)))
        grid = period / finest
        times: Floats = begin + grid * np.arange(cycles * finest + 1, dtype=np.float64)
        samples = motion.sample(times)
        joints = joints_along(gimbal, times, samples.q, samples.position, self.joints)
        velocity, acceleration, _ = _tool(motion.limits)
        linear = motion.limits.linear_velocity, motion.limits.linear_acceleration
        path_times = pace(
            gimbal.axes,
            (joints, orientations(gimbal, joints), samples.position),
            period,
            grid=grid,
            tool=(velocity, acceleration, *linear),
            fixed=(fixed[0] - begin, fixed[1] - begin),
            share=share,
        )
        return np.minimum(begin + path_times, end)

    def by_way(self, request: MotionRequest, refusal: PlanError | None = None) -> Motion | None:
        """Return the motion in which the axes turn together to a single keyframe, if there is one.

        *refusal* is the reason why the axes cannot follow the shortest turn, if that was tried.
        """
        is_homing = bool(request.device_options.get("home"))
        if not (is_homing or refusal is not None):
            return None
        is_moving = not self.start.is_at_rest
        if not (request.is_single and self.joints) or (is_moving and refusal is not None):
            return None
        (keyframe,) = request.keyframes
        if request.omega_end is not None or keyframe.turns:
            return None
        turn = partial(
            together,
            self.gimbal,
            self.joints,
            None if is_homing else keyframe.q,
            period=self.period,
            tool=_tool(self.limits.narrowed(request.limits)),
        )
        path = turn()
        if path is None:
            return None
        if is_moving:
            raise PlanError("the axes turn together from rest only; stop first")
        quickest = float(path.path_times[-1])
        pace = request.pace if isinstance(request.pace, float | int) else 1.0
        seconds = request.total or quickest / pace
        check_total(seconds, quickest)
        if seconds > quickest:
            path = turn(least=seconds) or path
        w, x, y, z = path.q[-1].tolist()
        goal = replace(keyframe, q=(w, x, y, z), free_roll=False)
        motion = self.planned(replace(request, keyframes=[goal], duration=None, pace=None))
        share = motion.duration / path.path_times[-1]
        motion = reshaped(
            motion, replace(path, path_times=share * path.path_times), self.gimbal.axes
        )
        if refusal is None:
            return motion
        return replace(motion, request=request).noted(f"not by the shortest turn: {refusal}")

    def fitted(self, motion: Motion) -> Motion:
        """Return *motion* on the path of the axes at its own pace.

        Raises:
            PlanError: the axes cannot follow.
        """
        grid = motion.period * np.arange(motion.record_count, dtype=np.float64)
        if not self._keeps_times(motion):
            return self._reshaped(motion, self._routed(motion, grid))
        path = route_at_times(
            self.gimbal,
            motion.period,
            motion.sample(grid).q,
            (motion.start_time, motion.end_time),
            joints=self.joints,
            before=self.before,
            tool=_tool(motion.limits),
            keep_out=self.keep_out,
        )
        return self._reshaped(motion, path)

    def _keeps_times(self, motion: Motion) -> bool:
        """Return whether the axes leave the path of *motion* rather than let it wait for them."""
        return motion.request.times is not None and self.gimbal.allow_slews

    def _routed(self, motion: Motion, path_times: Floats) -> JointPath:
        """Return the path of the axes along *motion* at *path_times*, cycle by cycle."""
        return route(
            self.gimbal,
            motion.period,
            motion.sample(path_times).q,
            joints=self.joints,
            before=self.before,
            tool=_tool(motion.limits),
            free=self.free,
        )

    def _reshaped(self, motion: Motion, path: JointPath) -> Motion:
        axes = self.gimbal.axes
        rates = self._rates(motion, path)
        found = reshaped(
            motion, path, axes, joints_before=self.before, joint_rates=self.rates, rates=rates
        )
        if not self.gimbal.is_pointing:
            return found
        # Only the direction counts, with whatever roll the axes give it.
        reached = found.sample(found.keyframe_times).q
        error = float(np.max(pointing_error(self.gimbal, reached, found.request.keys)))
        return replace(found, certificate=replace(found.certificate, keyframe_error=error))

    def _rates(self, motion: Motion, path: JointPath) -> Floats | None:
        """Return the axis velocities at the records of *motion* at a pace, rad/s.

        They are those of the path itself; ``None`` if the axes leave it.
        """
        times, step = path.path_times, _NEAR * motion.period
        off = angle(path.q, motion.sample(np.minimum(times, motion.duration)).q)
        if self.gimbal.is_pointing or float(np.max(off)) > SAME_ANGLE:
            return None
        around = np.clip(times[:, None] + [-step, step], 0.0, motion.duration)
        beside = around.ravel()
        samples = motion.sample(beside)
        near = self.joints or tuple(path.joints[0].tolist())
        joints = joints_along(self.gimbal, beside, samples.q, samples.position, near)
        change = np.diff(joints.reshape(len(times), 2, -1), axis=1)[:, 0]
        spans = np.diff(around, axis=1)
        rates = np.divide(change, spans, out=np.zeros_like(change), where=spans > 0.0)
        rates *= np.gradient(times)[:, None] / motion.period
        # On the other branch the inner axes turn the other way.
        rates *= np.where(np.sum(rates * np.gradient(path.joints, axis=0), axis=0) < 0.0, -1, 1)
        rates[-1] = 0.0
        if self.start.is_at_rest:
            rates[0] = 0.0
        return rates


def _slower(times: float) -> str:
    """Return the note on a motion that its axes slow down."""
    return f"the axes need {times:.3f} times as long"


def _tool(limits: Limits) -> ToolLimits:
    """Return the angular rates that keep *limits* about any axis."""
    numbers = limits.numbers()
    return ToolLimits(min(numbers[:4]), min(numbers[4:8]), min(numbers[8:12]))


_SAME_TIME = 1e-9


def reshaped(
    motion: Motion,
    shape: JointPath,
    axes: Sequence[AxisLimits],
    *,
    joints_before: Sequence[Sequence[float]] = (),
    joint_rates: Sequence[float] = (),
    rates: Floats | None = None,
) -> Motion:
    """Return *motion* on the path of *shape*, checked against its limits again.

    Args:
        motion: the motion as planned.
        shape: the path that the device's axes follow, on the same grid.
        axes: limits of the axes.
        joints_before: axis angles of the three records before a motion that begins in motion.
        joint_rates: axis velocities at the start of a motion that begins in motion, rad/s.
        rates: axis velocities at the records, as for :meth:`.RecordedPath.of`.

    Raises:
        LimitError: the shaped path breaks a limit.
        StartError: the shaped path begins elsewhere than a motion that begins in motion.
        ValueError: *motion* already has a shape.
    """
    if not isinstance(motion.path, Path):
        raise ValueError("motion already has a path of the axes")
    period, request = motion.period, motion.request
    path_times, q, joints = shape.path_times, shape.q, shape.joints
    begun = float(angle(q[0], motion.start_state.q))
    if begun > SAME_ANGLE and not motion.start_state.is_at_rest:
        raise StartError(
            f"the device's axes begin {begun:.3g} rad from where the motion takes over in motion"
        )
    earlier = np.asarray(joints_before, dtype=np.float64) if len(joints_before) else None
    start = motion.start_state
    if start.is_at_rest and begun > SAME_ANGLE:
        # The axes are unknown, so the plan has chosen the roll in which they begin.
        start = replace(start, q=q[0], before=None)
    path = RecordedPath.of(q, path_times, motion.path, period, joints, earlier, joint_rates, rates)

    def moved(times: Floats) -> Floats:
        """Return when the shaped path reaches *times* of the planned path."""
        grid = period * np.arange(len(path_times), dtype=np.float64)
        if len(path_times) == motion.record_count and np.allclose(
            path_times, grid, rtol=0, atol=1e-9
        ):
            return times
        found = np.searchsorted(path_times, times - _SAME_TIME)
        return np.minimum(found, len(path_times) - 1) * period

    times = moved(motion.keyframe_times)
    records = AxisRecords(joints, path.joint_rates, path.earlier, axes)
    certificate = certificate_of(
        path, len(path_times), times, request, start, motion.limits, period, records
    )
    return replace(
        motion,
        path=path,
        start_time=float(times[0]),
        end_time=float(times[-1]),
        keyframe_times=times,
        record_count=len(path_times),
        certificate=replace(
            certificate,
            figures=(*certificate.figures, *shape.figures),
            losses=shape.losses,
            notes=(*motion.certificate.notes, *certificate.notes, *shape.notes),
        ),
        first_joints=tuple(joints[0].tolist()),
        last_joints=tuple(joints[-1].tolist()),
    )
