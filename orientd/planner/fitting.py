"""Plans for a gimbal: on the path that its axes follow, as fast as the axes allow.

A motion is timed for the tool and the axes at once, as the motions of all other devices are.  If it
begins in motion, or its keyframes have times, the timing of the tool alone comes first: it leaves
more of the limits.  Only with times may the axes leave the path while it does not wait for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from orientd.curves.contract import METHODS
from orientd.driver import ZERO, Joints
from orientd.errors import PlanError
from orientd.mechanism import Gimbal
from orientd.mechanism.arrays import row_of
from orientd.mechanism.joint_path import ToolLimits
from orientd.mechanism.keep_out_slews import Clearance
from orientd.mechanism.pointing import pointing_error
from orientd.mechanism.poles import check_leaving, passes_pole
from orientd.mechanism.routing import beginnings
from orientd.mechanism.timed_route import route_at_times
from orientd.mechanism.turning import turned_to
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner.certifying import reshaped, with_axes
from orientd.planner.errors import TotalError
from orientd.planner.motion import Motion
from orientd.planner.path import Path
from orientd.planner.planning import plan
from orientd.planner.refusal import stopping_first
from orientd.planner.resolve import resolved
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.rotation import angle

_MET = 1e-2
"""Angle by which a motion may pass a keyframe besides what the gimbal allows, rad."""

_DEVIATIONS = 0.0, 0.25, 0.5, 1.0
"""Shares of the allowed deviation, of which the least counts with which the axes can follow."""


@dataclass(frozen=True, slots=True, eq=False)
class Fitting:
    """Planner for a gimbal, on the path that its axes follow.

    Attributes:
        gimbal: kinematics and limits of the axes.
        start: the commanded state of the device.
        joints: axis angles there, rad; empty if unknown.
        limits: the device's.
        period: the device's cycle, s.
        before: planned axis angles of the previous cycles, if it moves, oldest first; see
            :meth:`.RecordedMotion.joints_before`.
        rates: planned axis velocities there, rad/s.
        motion_id: identifier of the motion; by default a new random one.
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
    keep_out: tuple[Clearance, ...] = ()

    def plan(self, request: MotionRequest) -> Motion:
        """Return the requested motion on the path that the device's axes follow.

        Raises:
            RequestError: its method or the device does not allow the request.
            PlanError: it cannot be planned, an axis cannot follow, or it would break a limit.
        """
        if not self.joints and not self._leaves_path(request):
            return self._from_any_turn(request)
        axes = self._axes
        if request.device_options.get("home") and request.is_single:
            if not self.start.is_at_rest:
                raise PlanError("the axes turn together from rest only; stop first")
            home, (keyframe,) = self.gimbal.home(), request.keyframes
            there = replace(keyframe, q=self.gimbal.orientation(home), free_roll=False)
            return self._timed(replace(request, keyframes=[there]), replace(axes, goal=home))
        if self.start.is_at_rest and request.times is None:
            try:
                return self._timed(request, axes)
            except TotalError:
                raise
            except PlanError as error:
                goal = self._goal(request)
                if not goal:
                    raise
                refusal = error
            with suppress(PlanError):
                return self._timed(request, replace(axes, goal=goal))
            raise refusal
        # From one velocity to another a timing for the axes leaves too much of the limits.
        motion = self._planned(request)
        try:
            return self.followed(motion)
        except PlanError as error:
            refusal = error
        # Times of the user leave the lead-in alone to the timing.
        if request.times is None or (motion.start_time > 0.0 and not self._leaves_path(request)):
            with suppress(PlanError):
                return self._timed(request, axes)
        if self.start.is_at_rest:
            raise refusal
        raise stopping_first(refusal)

    def _from_any_turn(self, request: MotionRequest) -> Motion:
        """Return the requested motion from the first axis angles with which it is possible."""
        refusal: PlanError | None = None
        for joints in beginnings(self.gimbal, row_of(self.start.q), ZERO):
            q = self.gimbal.orientation(joints)
            begun = replace(self, start=replace(self.start, q=np.array(q)), joints=joints)
            asked = request
            if len(joints) == 2 and not request.approach:
                # Two axes begin with the roll that they have there.
                first, *others = request.keyframes
                asked = replace(request, keyframes=[replace(first, q=q), *others])
            try:
                motion = begun.plan(asked)
            except PlanError as error:
                refusal = refusal or error
                continue
            return self._pointing(replace(motion, request=request))
        raise refusal or PlanError("there is no way")

    def _goal(self, request: MotionRequest) -> Joints:
        """Return the axis angles to which all axes turn least to a single keyframe; or none."""
        if not request.is_single or request.keyframes[0].turns or request.omega_end is not None:
            return ()
        (keyframe,) = resolved(request, self.start, self.limits).keyframes
        with suppress(PlanError):
            return turned_to(self.gimbal, self.joints, keyframe.q)
        return ()

    @property
    def _axes(self) -> Axes:
        return Axes(self.gimbal, self.joints, self.before, self.rates)

    def _timed(self, request: MotionRequest, axes: Axes) -> Motion:
        """Return the motion that is timed for tool and axes at once."""
        if request.is_single and isinstance(request.pace, float | int):
            # The limits of the axes have a share in how long it takes.
            quickest = self._timed(replace(request, pace=None), axes).duration
            slower = replace(request, pace=None, duration=quickest / request.pace)
            return replace(self._timed(slower, axes), request=request)
        return self._pointing(self._planned(request, axes))

    def _planned(self, request: MotionRequest, axes: Axes | None = None) -> Motion:
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
        """Return the *motion* of a tool with the axes on its path.

        Raises:
            PlanError: the axes cannot follow it, nor lead back to it.
        """
        axes = self._axes
        refusal: PlanError | None = None
        deviations = {share * self.gimbal.max_deviation for share in _DEVIATIONS}
        if not (isinstance(motion.path, Path) and passes_pole(self.gimbal, motion.path.trajectory)):
            deviations = {0.0}
        for deviation in sorted(deviations):
            try:
                return self._pointing(with_axes(motion, axes, deviation))
            except PlanError as error:
                refusal = refusal or error
        if refusal is not None and not self._leaves_path(motion.request):
            if motion.request.times is not None and isinstance(motion.path, Path):
                check_leaving(self.gimbal, motion.path.trajectory, axes.joints)
            raise refusal
        grid = motion.period * np.arange(motion.record_count, dtype=np.float64)
        path = route_at_times(
            self.gimbal,
            motion.period,
            motion.sample(grid).q,
            (motion.start_time, motion.end_time),
            joints=self.joints,
            before=self.before,
            tool=ToolLimits.of(motion.limits.numbers()),
            keep_out=self.keep_out,
        )
        return self._pointing(
            reshaped(
                motion, path, self.gimbal.axes, joints_before=self.before, joint_rates=self.rates
            )
        )

    def _leaves_path(self, request: MotionRequest) -> bool:
        """Return whether the axes leave the path rather than let it wait for them."""
        return request.times is not None and self.gimbal.allow_slews

    def _pointing(self, motion: Motion) -> Motion:
        """Return *motion* with the error of two axes at its keyframes.

        Raises:
            PlanError: the axes do not lead to a keyframe.
        """
        gimbal, error = self.gimbal, motion.certificate.keyframe_error
        if len(gimbal.axes) == 2:
            reached, asked = motion.sample(motion.keyframe_times).q, motion.request.keys
            # If only the direction counts, the axes give it whatever roll they have there.
            off = pointing_error(gimbal, reached, asked)
            error = float(np.max(off if gimbal.is_pointing else angle(reached, asked)))
        most = gimbal.max_deviation + (gimbal.roll_tolerance if gimbal.is_fitting else 0.0)
        is_met = METHODS[motion.request.method].interpolates and not motion.certificate.losses
        if is_met and error > most + _MET:
            raise PlanError(
                f"the axes lead past a keyframe, by {math.degrees(error):.3g} deg; give more "
                "keyframes, or one after the other"
            )
        return replace(motion, certificate=replace(motion.certificate, keyframe_error=error))
