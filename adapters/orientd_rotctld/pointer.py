"""Point a device where a program says: by single moves, or along the path of its positions."""

from __future__ import annotations

import math
import time

import numpy as np

from orientd.client.move_handle import MoveHandle
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import Floats, Quaternion, slerp
from orientd_rotctld.passes import Passes
from orientd_rotctld.prediction import Prediction
from orientd_rotctld.ranges import SLACK, Ranges
from orientd_serving.pointing import Direction, angles, direction, orientation, vectors
from orientd_serving.served import Served, named

_BEYOND, _LONGEST_BEYOND = 4.0, 5.0
"""How long the device follows the path after a position: in gaps between positions, and s after the
next one is due.  A program that is content with the measured direction sends none for a while."""
_QUICKEST = 0.4
"""Shortest gap that is planned for, s: positions that come more often are not missed by jitter."""
_RETURN = 2.0
"""Seconds of the way back to the last position, if none follows."""
_SEAM = 0.8
"""Share of a gap in which the device passes from one prediction to the next."""
_POSES = 64
"""Poses of a path that is sent."""
_START = 0.1
"""Seconds from a position until a new prediction takes effect."""
_NEAR = math.radians(15.0)
"""Largest angle from which a device at rest joins a path without a planned motion."""
_ZENITH = 5.0
"""Degrees from the zenith within which it does not show whether a device has tipped over."""
_THERE = 1e-6
"""Largest angle at which a direction is reached, rad: a stop may end shortly before it."""
_TURN = (60.0, 120.0)
"""Angles of a turn at a constant rate, degrees."""
_STILL = 1e-6
"""Speed below which a target rests, rad/s."""
_LOOKS = 65
"""Orientations of the direct motion that are compared with the ranges."""
_STEP = 10.0
"""Largest angle between two keyframes of a motion that stays in the ranges, degrees."""


class Pointer:
    """Points the tool of a device.

    Not for several threads at a time, except :meth:`stop`.

    Attributes:
        asked: the newest direction that was asked for; ``None`` before the first.
    """

    def __init__(self, served: Served, passes: Passes, ranges: Ranges) -> None:
        """Point a device.

        Args:
            served: the device.
            passes: the known ones.
            ranges: of the directions to point at; they may allow flip mode.
        """
        self._served, self._passes, self._ranges = served, passes, ranges
        self._prediction = Prediction()
        self._motion: MoveHandle | None = None
        self._goal: Floats | None = None
        self._is_following = False
        self._is_tipped = False
        self.asked: Direction | None = None

    def measured(self) -> Direction | None:
        """Return the measured direction; ``None`` without feedback.

        It is in the ranges, in the turn and the form of the newest question if that is possible.

        Raises:
            DaemonError: no daemon answers.
        """
        cycle = self._served.report().cycle
        if not cycle.HasField("feedback_q"):
            return None
        found = direction(to_quaternion(cycle.feedback_q), self._ranges.north)
        return self._ranges.form(found, self.asked or Direction(180.0, 45.0), SLACK)

    def stop(self) -> None:
        """Stop the device on its path.

        Raises:
            OrientdError: the servo does not answer, or no daemon does.
        """
        self._passes.leave()
        self._begin()
        self._served.stop()

    def go(self, wanted: Direction, rounding: float = 0.0) -> None:
        """Point at a direction, or follow the path that it continues.

        Args:
            wanted: where to.
            rounding: of its angles, degrees.

        Raises:
            OrientdError: the daemon refuses it.
        """
        before = self.asked or wanted
        if self._passes.takes(vector(wanted), lambda: self._move(wanted, before)):
            self._begin()
            self.asked = wanted
            return
        now, old = time.monotonic(), self._prediction
        if not old.is_confirmed:
            old = old.rounded(math.radians(rounding))
        is_same, self.asked = wanted == self.asked, wanted
        path = self._prediction = old.added(now, vector(wanted))
        if path.is_confirmed and not (is_same and path.speed < _STILL):
            self._follow(now, wanted, before, old if old.is_confirmed else path)
        elif not (is_same and self._is_heading(wanted, _THERE)):
            self._move(wanted, before)

    def turn(self, signs: tuple[int, int], share: float) -> None:
        """Turn from rest at a constant rate, for at most 120 degrees, to an end of the ranges.

        Args:
            signs: of the turn in azimuth and elevation.
            share: of the velocity limit.

        Raises:
            OrientdError: the daemon refuses it.
        """
        self._passes.leave()
        self._served.rest()
        form = self._now()
        begin = self._ranges.form(form, self.asked or form, SLACK)
        stages = [
            self._ranges.nearest(
                Direction(begin.azimuth + angle * signs[0], begin.elevation + angle * signs[1])
            )
            for angle in _TURN
        ]
        self._begin()
        self.asked = stages[-1]
        if math.dist(vector(begin), vector(stages[-1])) < _THERE:
            return  # at the end of a range
        poses = [self._pose(self._form(vector(one), form)) for one in dict.fromkeys(stages)]
        limits = {"velocity": share * self._served.report().limits.velocity}
        self._served.move(poses, approach=True, limits=limits)

    def _begin(self) -> None:
        """Start over: the next position continues none before it."""
        self._motion, self._goal, self._is_following = None, None, False
        self._prediction = Prediction()

    def _is_heading(self, wanted: Direction, tolerance: float) -> bool:
        """Return whether the device is close to a direction, or moves to where that is."""
        is_moving = self._motion is not None and not self._motion.is_done
        end = self._goal if is_moving and self._goal is not None else vector(self._now())
        return math.dist(end, vector(wanted)) < tolerance

    def _move(self, wanted: Direction, before: Direction) -> None:
        """Move to a direction, within the ranges.

        Args:
            wanted: the direction.
            before: the one that was asked for before, whose turn the device is in.
        """
        poses = [self._pose(self._form(vector(wanted), self._now()))]
        if not self._keeps_ranges(poses[0]):
            self._served.rest()
            poses = self._within_ranges(wanted, before)
        self._motion, self._is_following = self._served.move(poses, approach=True), False
        self._goal = vector(wanted)

    def _keeps_ranges(self, pose: Quaternion) -> bool:
        """Return whether the shortest turn to an orientation stays in the ranges.

        A device that moves leaves that turn by about the angle that it takes to stop.
        """
        report = self._served.report()
        begin, rate = to_quaternion(report.cycle.q), report.cycle.omega_body
        margin = math.degrees(_stopping_angle(report.limits, math.hypot(rate.x, rate.y, rate.z)))
        end = np.array([pose.w, pose.x, pose.y, pose.z])
        shorter = math.copysign(1.0, float(np.dot(begin, end)))
        way = slerp(begin, shorter * end, np.linspace(0.0, 1.0, _LOOKS)).tolist()
        kept = self._ranges.narrowed(margin)
        return all(kept.has_form(direction((w, x, y, z), self._ranges.north)) for w, x, y, z in way)

    def _within_ranges(self, wanted: Direction, before: Direction) -> list[Quaternion]:
        """Return keyframes from the device's orientation to a direction, all in the ranges.

        Azimuth and elevation change in proportion, from one allowed value to another.
        """
        form = self._now()
        q = self._served.report().cycle.q
        begin = self._ranges.form(form, before, SLACK)
        azimuth, elevation = wanted.azimuth - begin.azimuth, wanted.elevation - begin.elevation
        count = math.ceil(max(abs(azimuth), abs(elevation)) / _STEP)
        poses = [named(to_quaternion(q))]
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            point = Direction(begin.azimuth + share * azimuth, begin.elevation + share * elevation)
            form = self._form(vector(point), form)
            poses.append(self._pose(form))
        return poses

    def _now(self) -> Direction:
        """Return the direction of the newest setpoint, tipped over if the device is."""
        form = direction(to_quaternion(self._served.report().cycle.q), self._ranges.north)
        if abs(abs(form.elevation) - 90.0) > _ZENITH:
            self._is_tipped = abs(form.elevation) > 90.0
        return form

    def _pose(self, form: Direction) -> Quaternion:
        return named(orientation(form, self._ranges.north))

    def _follow(self, now: float, wanted: Direction, asked: Direction, before: Prediction) -> None:
        """Send the predicted path for the time until the position after the next."""
        path = self._prediction
        form = self._now()
        apart = math.dist(vector(form), path.at(now))
        # A device that follows continues: its axes may have to unwind, far from the target.
        if apart > _NEAR and not self._is_following:
            if not self._is_heading(wanted, _NEAR):
                self._move(wanted, asked)
            return
        gap = max(path.gap, _QUICKEST)
        beyond = min(_BEYOND * gap, gap + _LONGEST_BEYOND)
        times = np.linspace(now + _START, now + beyond + _RETURN, _POSES)
        seam = _smooth((times - now) / (_SEAM * gap))[:, None]
        points = before.at(times) + seam * (path.at(times) - before.at(times))
        back = _smooth((times - now - beyond) / _RETURN)[:, None]
        points += back * (vector(wanted) - points)
        poses: list[Quaternion] = []
        near = wanted
        for point in points / np.linalg.norm(points, axis=1, keepdims=True):
            near = self._ranges.form(Direction(*angles(point).tolist()), near)
            kept = self._ranges.nearest(near)
            form = self._form(point if kept == near else vector(kept), form)
            poses.append(self._pose(form))
        self._motion, self._is_following = None, False
        self._served.track().chunk(
            poses, rate=1.0 / float(times[1] - times[0]), start=float(times[0])
        )
        self._is_following = True

    def _form(self, point: Floats, near: Direction) -> Direction:
        """Return a unit vector as the direction of a tool, tipped over or not as the device is."""
        found = Direction(*angles(point).tolist())
        if self._ranges.tips:
            around = Ranges((near.azimuth - 180.0, near.azimuth + 180.0), (-180.0, 180.0))
            return around.form(found, near)
        return found.tipped() if self._is_tipped else found


def _stopping_angle(limits: pb.Limits, speed: float) -> float:
    """Return about the angle in which a device at *speed* comes to rest, twice the least one, rad.

    Limits that name no acceleration are those of axes, and not known here.
    """
    each = limits.axis_acceleration
    acceleration = limits.acceleration or min(each.x, each.y, each.z)
    return speed * speed / acceleration if acceleration > 0.0 else 0.0


def vector(wanted: Direction) -> Floats:
    """Return a direction as a unit vector, shape ``(3,)``."""
    return vectors(wanted.azimuth, wanted.elevation)


def _smooth(share: Floats) -> Floats:
    """Return a step from 0 to 1 whose first and second derivatives begin and end at 0."""
    u = np.clip(share, 0.0, 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))
