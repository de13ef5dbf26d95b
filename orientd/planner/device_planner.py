"""Plans for one device: from where it is commanded to be, and as its axes can follow them.

Where the driver refuses a path whose times are not the user's, the motion is planned again, slower:
first until it fits, then by bisection nearly as fast as the axes allow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np

from orientd.driver import Driver, Quaternion, ShapedPath, tune
from orientd.errors import LimitError, LimitKind, PlanError, RequestError
from orientd.planner.axis_path import reshaped
from orientd.planner.blending import blend
from orientd.planner.limits import Limits
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.recorded import RecordedMotion
from orientd.planner.refusal import check_total
from orientd.planner.request import Frame, MotionRequest, State
from orientd.planner.resolve import at_rate, in_device_coordinates, report_frame
from orientd.rotation import Floats, rotate
from orientd.stream import tuning_text

_EXAMINED_EVERY = 0.008
"""How far apart in path time the poses are that a driver looks at, s."""

_POWERS = {
    LimitKind.VELOCITY: 1,
    LimitKind.ACCELERATION: 2,
    LimitKind.JERK: 3,
    LimitKind.TIME: 1,
}
"""How what a limit is about falls with the speed; a stop takes less long, too."""
_STEP = 0.8
_SLOWEST = 0.1
"""Share of the device's speed below which no motion is slowed down for its axes."""
_SHARES = (0.8, 0.5)
"""Of the accelerations, for a pace that changes little; less leaves more to change it with."""
_BEYOND = 0.1
"""How far beyond a lead-in its pace is looked for, s."""
_FINEST, _FINEST_OF_LEAD, _MOST_SAMPLES = 16, 64, 40_000
"""Samples in a cycle on which a pace is looked for, and in all: near a pole axes turn quickly.

A lead-in to times of the user may pass the pole however closely, and is short.
"""
_LONG = 1.5
"""How much longer a pace may make a motion before all of it is tried slower, too."""
_CLOSE = 1.02
"""How near the slowest speed refused and the one that fits come to each other."""
_GIVEN = 0.2
"""For how long after it takes over from a motion its speed is that motion's, s."""
_ATTEMPTS = 16
"""Plans made at most: each costs as much as the first."""


class DevicePlanner:
    """Plan motions that a device's driver agrees to.

    Args:
        examiner: a driver of the device, which need not be open.
        limits: the device's.
        period: its cycle, s.
        frames: that requests may name, by name.
    """

    def __init__(
        self,
        examiner: Driver,
        *,
        limits: Limits,
        period: float,
        frames: Mapping[str, Frame] | None = None,
    ) -> None:
        self._examiner = examiner
        self._limits = limits
        self._period = period
        self._frames = frames or {}

    def placed(self, request: MotionRequest, start: State | None) -> MotionRequest:
        """Return *request* in the coordinates of the device; see :func:`in_device_coordinates`."""
        request = in_device_coordinates(self._framed(request), start)
        if start is None:
            return request
        return at_rate(request, start, self._limits.narrowed(request.limits))

    def report_frame(self, request: MotionRequest) -> Frame | None:
        """Return the frame that reports of *request* are in; see :func:`.report_frame`."""
        return report_frame(self._framed(request))

    def _framed(self, request: MotionRequest) -> MotionRequest:
        """Return *request* with the frames that it may name; its own come before the device's."""
        frames = {**self._frames, **request.frames}
        return replace(request, frames=frames) if self._frames else request

    def plan(
        self,
        request: MotionRequest,
        *,
        start: State,
        joints: Sequence[float],
        before: Sequence[tuple[float, ...]] = (),
        motion_id: str | None = None,
        is_offline: bool = False,
    ) -> Motion:
        """Plan a motion from *start*.

        Args:
            request: what to do.
            start: where the device is commanded to be.
            joints: its axis angles there, rad.
            before: axis angles planned for the cycles before, where it moves.
            motion_id: names the motion; by default a new random name.
            is_offline: whether the device is not to be asked for anything.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        self._check_options(request)
        request = self.placed(request, start)
        fitting = Fitting(
            self._examiner, start, tuple(joints), self._limits, self._period, before, motion_id
        )
        try:
            motion = fitting.plan(request)
        except LimitError as error:
            other = self._with_roll_of_axes(request)
            if other is None or error.kind is not LimitKind.RANGE:
                raise
            motion = fitting.plan(other)
        self._examine(motion, tuple(joints), is_offline=is_offline)
        return motion

    def _with_roll_of_axes(self, request: MotionRequest) -> MotionRequest | None:
        """Return *request* with the roll that the device's axes have it, where that is free."""
        keyframes = []
        for keyframe in request.keyframes:
            if keyframe.free_roll:
                x, y, z = rotate(np.array(keyframe.q), np.eye(3)[0]).tolist()
                q = self._examiner.pointed((x, y, z), request.pointing_axis)
                if q is None:
                    return None
                keyframe = replace(keyframe, q=q, free_roll=False)
            keyframes.append(keyframe)
        return None if keyframes == request.keyframes else replace(request, keyframes=keyframes)

    def blend(
        self,
        first: RecordedMotion,
        request: MotionRequest,
        *,
        tolerance: float,
        earliest: int,
        motion_id: str | None = None,
    ) -> tuple[int, Motion]:
        """Plan a motion that follows *first* without coming to rest between them.

        Args:
            first: the end of what runs before.
            request: what is to follow.
            tolerance: how far from the corner between them it may pass, rad.
            earliest: record of *first* before which it cannot be left any more.
            motion_id: names the motion; by default a new random name.

        Returns:
            The record of *first* at which to leave it, and the motion from there on.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            PlanError: it cannot be planned, or would break a limit.
        """
        if type(self._examiner).shape is not Driver.shape:
            # The driver makes a path of its own of every motion.
            record = first.last_record
            start, joints = first.state_at(record), first.facts.last_joints
            motion = self.plan(request, start=start, joints=joints, motion_id=motion_id)
            return record, motion
        record, motion = blend(
            first,
            self.placed(request, first.state_at(first.last_record)),
            tolerance=tolerance,
            limits=self._limits,
            period=self._period,
            earliest=earliest,
            motion_id=motion_id,
        )
        self._check_options(request)
        self._examine(motion)
        return record, motion

    def _check_options(self, request: MotionRequest) -> None:
        """Have the driver look at its options of this motion."""
        try:
            tuning_text(request.device_options)
            tune(self._examiner, request.device_options)
        except ValueError as error:
            raise RequestError("device_options", str(error)) from error

    def _examine(
        self, motion: Motion, joints: tuple[float, ...] = (), *, is_offline: bool = False
    ) -> None:
        """Have the driver look at a motion that keeps the limits."""
        if type(self._examiner).examine is Driver.examine:
            return
        step = max(1, round(_EXAMINED_EVERY / motion.period))
        times = motion.period * np.arange(0, motion.record_count, step)
        samples = motion.sample(times)
        poses = zip(samples.q.tolist(), samples.position.tolist(), strict=True)
        self._examiner.examine(times.tolist(), list(poses), joints, is_offline=is_offline)


@dataclass(frozen=True, slots=True, eq=False)
class Fitting:
    """Plan for a device on the path that its axes follow.

    Attributes:
        driver: looks at the path; need not be open.
        start: where the device is commanded to be.
        joints: its axis angles there, rad.
        limits: the device's.
        period: the device's cycle, s.
        before: axis angles planned for the cycles before, where it moves, the oldest first; see
            :meth:`.RecordedMotion.joints_before`.
        motion_id: names the motion; by default a new random name.
        free: up to which path time the path may stand while an axis turns at a pole, s.
    """

    driver: Driver
    start: State
    joints: tuple[float, ...]
    limits: Limits
    period: float
    before: Sequence[tuple[float, ...]] = ()
    motion_id: str | None = None
    free: float = 0.0

    def plan(self, request: MotionRequest) -> Motion:
        """Return the motion that a request asks for, on the path that the device's axes follow.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            PlanError: it cannot be planned, an axis cannot follow, or it would break a limit.
        """
        home = self._by_way(request)
        if home is not None:
            return home
        motion = self.planned(request)
        try:
            return self.followed(motion)
        except PlanError as error:
            refusal = error
        # As planned it has the roll that was free.
        way = self._by_way(motion.request, refusal)
        if way is not None:
            return way
        # What has times of the user's may stand before them only.
        free = math.inf if request.times is None else motion.start_time
        is_later = isinstance(refusal, LimitError) and refusal.time > free
        if free > 0.0 and not is_later:
            with suppress(PlanError):
                return replace(self, free=free).followed(motion)
        raise refusal

    def planned(self, request: MotionRequest) -> Motion:
        """Return what a request asks for, whatever the axes."""
        return plan(
            request,
            start=self.start,
            limits=self.limits,
            period=self.period,
            motion_id=self.motion_id,
        )

    def followed(self, motion: Motion) -> Motion:
        """Return *motion* as the axes can follow its path, or raise :class:`.PlanError`."""
        try:
            return self._fitted(motion)
        except LimitError as error:
            if error.kind is LimitKind.RANGE:
                raise
            is_fixed = motion.request.times is not None or error.kind not in _POWERS
            # No pace changes what the motion before leaves; whether one would do later is long to
            # find.
            is_given = not self.start.is_at_rest and error.time < _GIVEN and not is_fixed
            paced = None if is_given else self._paced(motion)
            if paced is not None and (is_fixed or paced.duration < _LONG * motion.duration):
                return paced
            if is_fixed:
                raise
            refusal = error
        # A pace keeps to the path exactly: where the axes may miss it, all of it slower may be
        # quicker.
        least = _SLOWEST if paced is None else max(_SLOWEST, motion.duration / paced.duration)
        try:
            evenly = self._slowed(motion, refusal, least)
        except PlanError:
            if paced is None:
                raise
            return paced
        return evenly if paced is None or evenly.duration < paced.duration else paced

    def _slowed(self, motion: Motion, refusal: LimitError, least: float) -> Motion:
        """Return *motion* planned with less of the device's speed for its axes, down to *least*."""
        own, speed, worst = motion.limits, 1.0, refusal
        fitted: Motion | None = None
        refused, fits = 1.0, 0.0
        for _ in range(_ATTEMPTS):
            if fitted is None:
                need = (worst.limit / worst.value) ** (1.0 / _POWERS[worst.kind])
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
                # Certified against the limits themselves: only the planning aimed below them.
                faster = self._fitted(replace(slow, limits=own))
            except PlanError as error:
                refused = speed
                if fitted is None:
                    if not isinstance(error, LimitError) or error.kind not in _POWERS:
                        raise refusal from error
                    worst = error
                continue
            fits = speed
            if fitted is None or faster.duration < fitted.duration:
                fitted = faster
        if fitted is None:
            raise refusal
        return fitted.noted(f"the axes need {fitted.duration / motion.duration:.3f} times as long")

    def _paced(self, motion: Motion) -> Motion | None:
        """Return *motion* at the pace that the driver finds for its axes, if that fits.

        Where the times are the user's and the axes cannot follow, this raises what is wrong.
        """
        period = motion.period
        refusal: PlanError | None = None
        is_timed = motion.request.times is not None
        for share in _SHARES:
            path_times = self._path_times(motion, share)
            if not len(path_times):
                return None
            try:
                shape = self._shaped(motion, motion.sample(path_times).q)
                if shape is None:
                    return None
                cycles = period * np.arange(len(path_times), dtype=np.float64)
                along = np.interp(shape.path_times, cycles, path_times)
                longer = (len(path_times) - 1) * period / motion.duration
                note = f"the axes need {longer:.3f} times as long"
                times = cast("Sequence[float]", along)
                shape = shape._replace(path_times=times, notes=(*shape.notes, note))
                return reshaped(motion, shape, joints_before=self.before)
            except PlanError as error:
                if refusal is None and is_timed:
                    # The driver says by how much too little time there is.
                    fixed = (motion.start_time, motion.end_time)
                    self._pace(motion, fixed, fixed, _SHARES[-1], _FINEST)
                refusal = refusal or error
                if isinstance(error, LimitError) and error.kind is LimitKind.RANGE:
                    refusal = error  # which no pace changes
                    break
        if refusal is not None and is_timed:
            raise refusal
        return None

    def _path_times(self, motion: Motion, share: float) -> Sequence[float]:
        """Return how far along *motion* to be in every cycle; slower where no times are given."""
        period, end = motion.period, motion.duration
        if motion.request.times is None:
            free = (math.inf, -math.inf)
            return self._pace(motion, (0.0, end), free, share, _FINEST).tolist()  # type: ignore[no-any-return]
        # What the times of the user leave is a lead-in; from the first keyframe on they hold.
        begin = motion.start_time
        lead = np.zeros(1)
        if begin > 0.0:
            after = min(end, begin + _BEYOND)
            fixed = (begin, after)
            lead = self._pace(motion, (0.0, after), fixed, share, _FINEST_OF_LEAD)
            lead = lead[lead <= begin]
        if not len(lead):
            return ()
        rest = np.arange(lead[-1] + period, end, period)
        return np.concatenate([lead, rest, [end]])  # type: ignore[return-value]

    def _pace(
        self,
        motion: Motion,
        span: tuple[float, float],
        fixed: tuple[float, float],
        share: float,
        finest: int,
    ) -> Floats:
        """Return the pace that the driver finds for the times of *span*, up to *finest* a cycle."""
        period, (begin, end) = motion.period, span
        cycles = math.ceil((end - begin) / period - 1e-9)
        finest = min(finest, max(1, _MOST_SAMPLES // (cycles + 1)))
        grid = period / finest
        path = _rows(motion.sample(begin + grid * np.arange(cycles * finest + 1)).q)
        fixed = (fixed[0] - begin, fixed[1] - begin)
        rates = _rates(motion.limits)
        path_times = self.driver.pace(
            period, path, grid=grid, fixed=fixed, rates=rates, share=share
        )
        return np.minimum(begin + np.asarray(path_times, dtype=np.float64), end)

    def _by_way(self, request: MotionRequest, refusal: PlanError | None = None) -> Motion | None:
        """Return the motion in which the axes turn together to a single keyframe, if there is one.

        The *refusal* says why the axes cannot follow the shortest turn, where that was tried.
        """
        is_moving = not self.start.is_at_rest
        if not (request.is_single and self.joints) or (is_moving and refusal is not None):
            return None
        (keyframe,) = request.keyframes
        if request.omega_end is not None or keyframe.turns:
            return None
        way = partial(
            self.driver.way,
            self.joints,
            keyframe.q,
            period=self.period,
            rates=_rates(self.limits.narrowed(request.limits)),
            is_refused=refusal is not None,
        )
        shape = way(least=0.0)
        if shape is None:
            return None
        if is_moving:
            raise PlanError("the axes turn together from rest only; stop first")
        quickest = shape.path_times[-1]
        pace = request.pace if isinstance(request.pace, float | int) else 1.0
        seconds = request.total or quickest / pace
        check_total(seconds, quickest)
        if seconds > quickest:
            shape = way(least=seconds) or shape
        w, x, y, z = map(float, shape.orientations[-1])
        goal = replace(keyframe, q=(w, x, y, z), free_roll=False)
        motion = self.planned(replace(request, keyframes=[goal], duration=None, pace=None))
        share = motion.duration / shape.path_times[-1]
        path_times = share * np.asarray(shape.path_times, dtype=np.float64)
        shape = shape._replace(path_times=cast("Sequence[float]", path_times))
        motion = reshaped(motion, shape)
        if refusal is None:
            return motion
        return replace(motion, request=request).noted(f"not by the shortest turn: {refusal}")

    def _shaped(self, motion: Motion, q: Floats) -> ShapedPath | None:
        rates = _rates(motion.limits)
        return self.driver.shape(
            motion.period, _rows(q), self.joints, self.before, rates, self.free
        )

    def _fitted(self, motion: Motion) -> Motion:
        if type(self.driver).shape is Driver.shape:
            return motion
        shape = self._shaped(motion, motion.records(0, motion.record_count)[:, :4])
        return motion if shape is None else reshaped(motion, shape, joints_before=self.before)


def _rows(q: Floats) -> Sequence[Quaternion]:
    """Return orientations as a driver takes them: an array is a sequence, and rows are many."""
    return cast("Sequence[Quaternion]", np.ascontiguousarray(q))


def _rates(limits: Limits) -> tuple[float, float, float]:
    """Return the angular rates that keep *limits* about whatever axis."""
    numbers = limits.numbers()
    return min(numbers[:4]), min(numbers[4:8]), min(numbers[8:12])
