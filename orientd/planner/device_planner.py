"""Plan for one device: from its commanded state, with a path that its axes can follow."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from orientd.driver import Driver, Feedback, Locatable, switch, tune
from orientd.errors import LimitError, LimitKind, LinkError, PlanError, RequestError
from orientd.keep_out import KeepOut
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.mechanism import Mechanical, Mechanism
from orientd.mechanism.turning import pointed, windings
from orientd.model.limits import Limits
from orientd.model.request import Frame, MotionRequest
from orientd.planner.blending import NOT_BLENDED, blend
from orientd.planner.certifying import with_axes
from orientd.planner.facts import HISTORY
from orientd.planner.fitting import Fitting
from orientd.planner.keep_out import Around, Cones, Planning
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.recorded import RecordedMotion
from orientd.planner.resolve import at_rate, in_device_coordinates, report_frame
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.rotation import rotate
from orientd.stream.memory import tuning_text


class DevicePlanner:
    """Plan motions for a device with the checks of its driver.

    Args:
        examiner: a driver of the device, which need not be open.
        limits: the device's.
        period: its cycle, s.
        frames: frames that requests may name, by name.
        keep_out: cones that every motion stays out of.
    """

    def __init__(
        self,
        examiner: Driver,
        *,
        limits: Limits,
        period: float,
        frames: Mapping[str, Frame] | None = None,
        keep_out: Sequence[KeepOut] = (),
    ) -> None:
        self._examiner = examiner
        self._limits = limits
        self._period = period
        self._frames = frames or {}
        self._keep_out = tuple(keep_out)

    def placed(self, request: MotionRequest, start: State | None) -> MotionRequest:
        """Return *request* in the coordinates of the device; see :func:`in_device_coordinates`."""
        request = in_device_coordinates(self._framed(request), start)
        if start is None:
            return request
        return at_rate(request, start, self._limits.narrowed(request.limits))

    def report_frame(self, request: MotionRequest) -> Frame | None:
        """Return the frame for reports of *request*; see :func:`.report_frame`."""
        return report_frame(self._framed(request))

    def _framed(self, request: MotionRequest) -> MotionRequest:
        """Return *request* with all frames that it may name; its own replace the device's."""
        frames = {**self._frames, **request.frames}
        return replace(request, frames=frames) if self._frames else request

    def plan(
        self,
        request: MotionRequest,
        *,
        start: State,
        joints: Sequence[float],
        before: Sequence[tuple[float, ...]] = (),
        rates: tuple[float, ...] = (),
        motion_id: str | None = None,
        is_offline: bool = False,
        unix_ns: int | None = None,
    ) -> Motion:
        """Plan a motion from *start*.

        Args:
            request: the requested motion.
            start: the commanded state of the device.
            joints: axis angles there, rad.
            before: planned axis angles of the previous cycles, if it moves.
            rates: planned axis velocities there, rad/s, if it moves.
            motion_id: identifier of the motion; by default a new random one.
            is_offline: whether not to ask the device anything.
            unix_ns: Unix time at the beginning of the motion, ns; required if a keep-out cone
                moves.

        Raises:
            RequestError: its method or the device does not allow the request.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        mechanism = self._mechanism(may_ask=not is_offline)
        self._check_options(request, mechanism)
        placed, limits = self.placed(request, start), self._limits

        axes = None if mechanism is None else Axes(mechanism, tuple(joints), before, rates)
        of_timing = None if axes is None else Axes(axes.mechanism, axes.joints, is_recorded=False)
        path_of = partial(plan, limits=limits, period=self._period, motion_id=motion_id)

        def path_from(state: State) -> Planning:
            return partial(path_of, start=state, axes=of_timing)

        planning, follow = path_from(start), None
        cones = self._cones(request, unix_ns)
        if isinstance(mechanism, Gimbal):
            keep_out = () if cones is None else (partial(cones.least, margins=1.0), cones.least)
            fitting = Fitting(
                mechanism, start, tuple(joints), limits, self._period, before, rates, motion_id,
                keep_out=keep_out,
            )  # fmt: skip
            planning, follow = partial(_fitted, fitting), fitting.followed
        elif axes is not None:
            planning = partial(path_of, start=start, axes=axes)
            follow = partial(with_axes, axes=axes)
        if cones is None:
            return planning(placed)
        around = Around(
            cones, start, planning, path_from, follow, is_turn=request.rate is not None,
            has_slews=isinstance(mechanism, Gimbal) and mechanism.allow_slews and placed.has_times,
        )  # fmt: skip
        return around.motion(placed)

    def _cones(self, request: MotionRequest, unix_ns: int | None) -> Cones | None:
        """Return the keep-out cones of a motion; ``None`` if there are none."""
        cones = (*self._keep_out, *request.keep_out)
        return Cones.of(cones, unix_ns) if cones else None

    def plan_offline(
        self, request: MotionRequest, *, from_device: bool = False, unix_ns: int | None = None
    ) -> Motion:
        """Plan a motion without a daemon, from rest.

        A motion with a lead-in begins at the pose of the device, if that is known.  Otherwise a
        motion begins at its first keyframe.

        Args:
            request: the requested motion.
            from_device: whether to ask the device for its pose; otherwise its options give it.
            unix_ns: Unix time at the beginning of the motion, ns, for keep-out cones that move; by
                default the time of this call.

        Raises:
            RequestError: its method or the device does not allow the request.
            PlanError: it cannot be planned, or the driver cannot ask its device for the pose.
            LinkError: the device does not answer.
        """
        unix_ns = time.time_ns() if unix_ns is None else unix_ns
        stands: Feedback | None = None
        if isinstance(self._examiner, Locatable):
            stands = self._examiner.offline_start(from_device=from_device)
        elif from_device:
            name = self._examiner.name
            raise PlanError(f"the driver {name!r} cannot ask its device for its pose")
        is_single = len(request.keyframes) == 1
        if is_single and stands is None:
            raise RequestError(
                "keyframes",
                "expected at least 2, got 1: a single one needs the current orientation, which "
                "only a daemon knows",
            )
        here = None if stands is None else State.at_rest(stands.q, stands.position)
        request = self.placed(request, here)
        if here is None or not (request.approach or is_single):
            elsewhere = stands.position if stands is not None else (0.0, 0.0, 0.0)
            position = request.keyframes[0].position or elsewhere
            here = State.at_rest(request.keys[0], position)
        # If the axis angles are unknown, the mechanism chooses.
        joints = stands.joints if stands is not None else ()
        return self.plan(
            request, start=here, joints=joints, is_offline=not from_device, unix_ns=unix_ns
        )

    def _mechanism(self, *, may_ask: bool) -> Mechanism | None:
        """Return the device's mechanism, or ``None`` if its driver has none.

        Raises:
            PlanError: the device does not tell which mechanism it has.
        """
        if not isinstance(self._examiner, Mechanical):
            return None
        try:
            return self._examiner.mechanism(may_ask=may_ask)
        except LinkError as error:
            raise PlanError(f"cannot predict the axes: {error}") from error

    def blend(
        self,
        first: RecordedMotion,
        request: MotionRequest,
        *,
        tolerance: float,
        earliest: int,
        motion_id: str | None = None,
        unix_ns: int | None = None,
    ) -> tuple[int, Motion]:
        """Plan a motion that follows *first* without a stop between them.

        Args:
            first: the end of the previous motion.
            request: the next motion.
            tolerance: largest distance from the corner between them, rad.
            earliest: the first record of *first* at which the blend may leave it.
            motion_id: identifier of the motion; by default a new random one.
            unix_ns: Unix time at the beginning of the motion, ns; required if a keep-out cone
                moves.

        Returns:
            The record of *first* at which to leave it, as in :func:`.blend`, and the motion from
            there on.

        Raises:
            RequestError: its method or the device does not allow the request.
            PlanError: it cannot be planned, or would break a limit.
        """
        mechanism = self._mechanism(may_ask=True)
        self._check_options(request, mechanism)
        cones = self._cones(request, unix_ns)
        why = [f"{NOT_BLENDED}: the axes of a gimbal come to rest between two motions"]
        end = first.state_at(first.last_record)
        if not isinstance(mechanism, Gimbal):
            placed = self.placed(request, end)
            record, motion = blend(
                first,
                replace(placed, keep_out=()),
                tolerance=tolerance,
                limits=self._limits,
                period=self._period,
                earliest=earliest,
                motion_id=motion_id,
                mechanism=mechanism,
            )
            if record > first.last_record:
                if mechanism is None and cones is None:
                    return record, motion
                why = [one for one in motion.certificate.notes if one.startswith(NOT_BLENDED)]
            else:
                try:
                    motion = self._followed(first, record, motion, mechanism)
                except LimitError as error:
                    if motion.corner is None:
                        raise
                    why = [f"{NOT_BLENDED}: {error}"]
                else:
                    if cones is None:
                        return record, motion
                    if cones.are_kept(motion):
                        return record, cones.certified(motion, placed)
                    why = [f"{NOT_BLENDED}: it would pass a keep-out cone"]
        motion = self.plan(
            request,
            start=State.at_rest(end.q, end.position),
            joints=first.facts.last_joints,
            motion_id=motion_id,
            unix_ns=unix_ns,
        )
        return first.last_record + HISTORY, motion.noted(*(why if tolerance > 0.0 else []))

    def _followed(
        self, first: RecordedMotion, record: int, motion: Motion, mechanism: Mechanism | None
    ) -> Motion:
        """Return a motion that leaves another one as the device's axes follow it.

        Raises:
            LimitError: an axis cannot follow it.
        """
        if mechanism is None:
            return motion
        joints, before = first.joints_at(record), first.joints_before(record)
        return with_axes(motion, Axes(mechanism, joints, before, first.joint_rates_at(record)))

    def _check_options(self, request: MotionRequest, mechanism: Mechanism | None) -> None:
        """Check the driver's options of this motion."""
        try:
            tuning_text(request.device_options)
            if switch("home", request.device_options.get("home", False)):
                _check_home(mechanism)
            tune(self._examiner, request.driver_options)
        except ValueError as error:
            raise RequestError("device_options", str(error)) from error


def _fitted(fitting: Fitting, request: MotionRequest) -> Motion:
    """Return the motion that a device's axes follow, with the roll that they give if it is free."""
    try:
        return fitting.plan(request)
    except LimitError as error:
        advice = ""
        if error.kind is LimitKind.RANGE:
            other = _with_roll_of_axes(request, fitting)
            if other is not None:
                return fitting.plan(other)
            advice = _turned_back(request, fitting)
        if not advice and _are_reached_alone(request, fitting):
            _, _, advice = str(error).partition("; ")
            advice = f"{advice}; the axes reach each keyframe in a motion of its own"
        if not advice:
            raise
        raise LimitError(
            error.quantity, error.value, error.limit, error.time, error.unit, advice,
            kind=error.kind,
        ) from error  # fmt: skip


def _check_home(mechanism: Mechanism | None) -> None:
    """Raise :class:`ValueError` if the device has no home."""
    if not isinstance(mechanism, Gimbal):
        raise ValueError("only a gimbal has a home, where its axes are at zero; got 'home' = true")


def _turned_back(request: MotionRequest, fitting: Fitting) -> str:
    """Return where a keyframe lets a gimbal turn the longer way; empty if none does."""
    mechanism = fitting.gimbal
    if request.is_single:
        return ""
    joints = fitting.joints or mechanism.home()
    for index, keyframe in enumerate(request.keyframes):
        if keyframe.turns or (keyframe.free_roll and not mechanism.is_pointing):
            return ""
        try:
            found = windings(mechanism, keyframe.q, joints)
        except LimitError:
            return ""
        last, joints = np.array(joints), min(found, key=lambda one: math.dist(one, joints))
        ways = np.abs(joints - last)
        place = int(np.argmax(ways))
        if ways[place] > math.pi:
            middle = math.degrees(0.5 * (joints[place] + last[place])) + 0.0
            return (
                f"the axes must turn the longer way to keyframes[{index}]: give one more keyframe "
                f"before it, with {mechanism.axes[place].name} at {middle:.1f} deg"
            )
    return ""


def _are_reached_alone(request: MotionRequest, fitting: Fitting) -> bool:
    """Return whether a gimbal turns to each of several keyframes if it is sent alone."""
    mechanism = fitting.gimbal
    if request.is_single or request.has_times or request.omega_end is not None:
        return False
    joints = fitting.joints or mechanism.home()
    for keyframe in request.keyframes:
        if keyframe.turns or (keyframe.free_roll and not mechanism.is_pointing):
            return False
        if mechanism.solve(keyframe.q, joints)[1] > mechanism.roll_tolerance:
            return False
        try:
            found = windings(mechanism, keyframe.q, joints)
        except LimitError:
            return False
        last = joints
        joints = min(found, key=lambda one: math.dist(one, last))
    return True


def _with_roll_of_axes(request: MotionRequest, fitting: Fitting) -> MotionRequest | None:
    """Return *request* with a free roll replaced by the one that a gimbal's axes give it."""
    mechanism = fitting.gimbal
    if mechanism.is_pointing:
        return None
    free = [k for k, keyframe in enumerate(request.keyframes) if keyframe.free_roll]
    if not free:
        return None
    directions = rotate(request.keys[free], np.eye(3)[0]).tolist()
    joints = fitting.joints or mechanism.home()
    found = pointed(mechanism, directions, request.pointing_axis, joints)
    if found is None:
        return None
    keyframes = list(request.keyframes)
    for index, angles in zip(free, found, strict=True):
        q = mechanism.orientation(angles)
        keyframes[index] = replace(keyframes[index], q=q, free_roll=False)
    return replace(request, keyframes=keyframes)
