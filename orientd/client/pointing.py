"""Point a device at moving targets, also from a moving base.

Samples of targets and of the base arrive with time stamps, from any thread.  With each sample,
orientd predicts both for the time at which the next sample will have arrived, and sends the device
a target for that time.  So the servo knows the motion ahead, in spite of delay and jitter.

The device takes poses in its base frame, called the world elsewhere.  On a moving base, points,
directions and orientations are in the earth frame.
"""

from __future__ import annotations

import json
import math
import threading
import time
from abc import ABC, abstractmethod
from typing import NamedTuple, get_args

from orientd.client.connection import Connection
from orientd.client.prediction import LONGEST_NS, Predictor, RateCheck, turning
from orientd.client.sight import AXES, NEAREST, Axis, PlanSight, PointSight, Roll, Sight, TurnSight
from orientd.client.target_messages import (
    Frame,
    check_life,
    check_stamp,
    is_in_world,
    orientation_of,
    vector_of,
)
from orientd.driver import IDENTITY, ZERO, Quaternion, Vector3
from orientd.errors import RequestError, StaleBaseError, StateError
from orientd.floats import conjugate, multiply, norm, normalize, plus, rotate_back
from orientd.model.request import Frame as NamedFrame
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import quaternion, to_quaternion, to_vector, vector
from orientd.spelling import did_you_mean
from orientd.tolerances import NORM_TOLERANCE

TRANSPORT = 0.01
"""Time that a target may take to the servo by default, s."""

SPACING_NS = 4_000_000
"""Least time between two targets."""

SPARE = 1.3
"""How much longer than usual the next sample may take, in multiples of the usual gap."""

USUAL = 0.05
"""Weight of the last gap in the usual one."""

REST_NS = 60_000_000_000
"""Time to live of a target at rest."""

AHEAD = 1.0
"""How far ahead of now a sample of a target may be stamped, s: it may be a prediction."""

AHEAD_BASE = 0.05
"""How far ahead of now a sample of the base may be stamped, s.  It is a measurement, so only the
conversion from another clock can make it one of the future."""

LONGEST_WAIT = 3600.0
"""How far from now the start of a plan may be, s."""

PLAN_RATE_HZ = 100.0
"""Samples a second of a plan to follow."""

MOST_AHEAD_NS = 100_000_000
"""How much later than due a target may be stamped, if calls are closer than :data:`SPACING_NS`."""


class BaseReport(NamedTuple):
    """State of the samples of the base.

    Attributes:
        samples: number of used samples.
        skipped: number of skipped samples: too old, out of order, not finite, not of unit norm, or
            with rates in another unit.
        time_ns: time of the newest sample, monotonic clock of this machine; 0 without a sample.
        age: age of the newest sample, s; infinity without a sample.
        is_stale: whether the newest sample is older than its time to live.
        stale_since_ns: time from which the base is stale; 0 without a sample.
    """

    samples: int
    skipped: int
    time_ns: int
    age: float
    is_stale: bool
    stale_since_ns: int


class Pointing(ABC):
    """Point at moving targets from a base that may move.

    Call the methods from any thread, about 10 to 250 times a second while something moves.

    Attributes:
        transport: longest time that a target takes to reach the servo, s.  Raise it for a slow
            network.
        skipped: number of skipped samples of points, directions and orientations: expired, or not
            newer than those before.
    """

    def __init__(self, connection: Connection, device: str) -> None:
        """Create it for *device*, at which nothing has been pointed yet."""
        self.transport = TRANSPORT
        self.skipped = 0
        self._connection, self._device = connection, device
        self._lock = threading.RLock()
        self._sight: Sight | None = None
        self._base: Predictor[Quaternion] | None = None
        self._base_life_ns = 0
        self._samples = self._skipped_samples = 0
        self._frames: dict[str, NamedFrame] | None = None
        # The orientation of the base for the last target, and that target.
        self._target: tuple[Quaternion, Quaternion] | None = None
        self._stamp_ns = self._emitted_ns = self._used_ns = 0
        self._gap_ns = 0.0

    @property
    @abstractmethod
    def report(self) -> pb.TrackResponse:
        """The newest report."""

    @abstractmethod
    def hand_over(self, message: pb.TrackTarget) -> None:
        """Send a target; returns at once."""

    def look_at(
        self,
        point: object,
        *,
        velocity: object = None,
        place: object = None,
        roll: Roll = "least",
        frame: str = "",
        pointing_axis: Axis = "x",
        time_ns: int = 0,
        time_to_live: float = 0.5,
    ) -> None:
        """Look at a point, which may move; return at once.

        Args:
            point: in the base frame, m; with :meth:`base` in the earth frame.
            velocity: of the point, m/s.  ``None`` derives it from successive calls, and is 0 for a
                single one.
            place: position to look from, m; by default the position of the tool.
            roll: ``"least"`` does not turn about the line of sight; a number is the roll angle from
                level, degrees.
            frame: name of a frame of the device, for the point and the pointing axis.  It turns
                with the base.  Empty for none.
            pointing_axis: tool axis that points.
            time_ns: time of the sample, :func:`time.monotonic_ns` of this machine; 0 for now.
            time_to_live: the device comes to rest if no new sample of a moving point arrives for
                this long, s.

        Raises:
            RequestError: an argument is malformed.
            StaleBaseError: the base is stale.  The device uses the point once it is not.
            OrientdError: tracking has ended.
        """
        found = self._frame(frame)
        at, speed = _finite(vector_of(point, "point"), "point"), _optional(velocity, "velocity")
        if place is not None:
            seen_from = _finite(vector_of(place, "place"), "place")
        else:
            seen_from = to_vector(self.report.position)
            if frame:
                seen_from = rotate_back(found.base.q, plus(seen_from, found.base.position, -1.0))
        line = plus(at, seen_from, -1.0)
        if not norm(line) > NEAREST:
            raise RequestError("point", f"expected a point away from {seen_from}, got {at}")
        self._point(at, speed, seen_from, roll, frame, pointing_axis, time_ns, time_to_live)

    def point(
        self,
        azimuth: float,
        elevation: float,
        *,
        azimuth_rate: float | None = None,
        elevation_rate: float | None = None,
        roll: Roll = "least",
        frame: str = "",
        pointing_axis: Axis = "x",
        time_ns: int = 0,
        time_to_live: float = 0.5,
    ) -> None:
        """Point in a direction, which may turn; return at once.

        Args:
            azimuth: about z, from x towards y, degrees.
            elevation: above the plane of x and y, degrees, from -180 to 180.
            azimuth_rate: degrees/s; 0 if only the other rate is given.  Without both, they are
                derived from successive calls.
            elevation_rate: degrees/s.
            roll: as for :meth:`look_at`.
            frame: as for :meth:`look_at`.
            pointing_axis: as for :meth:`look_at`.
            time_ns: as for :meth:`look_at`.
            time_to_live: as for :meth:`look_at`.

        Raises:
            RequestError: an argument is malformed.
            StaleBaseError: the base is stale.  The device uses the direction once it is not.
            OrientdError: tracking has ended.
        """
        a, e = _degrees(azimuth, "azimuth"), _degrees(elevation, "elevation")
        if abs(e) > math.pi:
            problem = f"expected -180 to 180 degrees, got {elevation:.10g}; check the decimal point"
            raise RequestError("elevation", problem)
        line = (math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e))
        rate = None
        if azimuth_rate is not None or elevation_rate is not None:
            u = _degrees(azimuth_rate or 0.0, "azimuth_rate")
            v = _degrees(elevation_rate or 0.0, "elevation_rate")
            rate = (
                -u * line[1] - v * math.sin(e) * math.cos(a),
                u * line[0] - v * math.sin(e) * math.sin(a),
                v * math.cos(e),
            )
        self._point(line, rate, None, roll, frame, pointing_axis, time_ns, time_to_live)

    def aim_in_world(
        self,
        target: object,
        *,
        angular_velocity: object = None,
        velocity_frame: Frame = "body",
        time_ns: int = 0,
        time_to_live: float = 0.5,
    ) -> None:
        """Aim at an orientation in the earth frame; return at once.

        Args:
            target: in a form that :meth:`.Tracking.aim` takes.
            angular_velocity: of the target, rad/s.  ``None`` derives it from successive calls.
            velocity_frame: the frame of that velocity.
            time_ns: as for :meth:`look_at`.
            time_to_live: as for :meth:`look_at`.

        Raises:
            RequestError: an argument is malformed.
            StaleBaseError: the base is stale.  The device uses the target once it is not.
            OrientdError: tracking has ended.
        """
        q = _unit(orientation_of(target))
        if q is None:
            raise RequestError("target", f"expected a unit quaternion, got {target!r}")
        omega = _body_rate(q, angular_velocity, velocity_frame)
        now_ns = time.monotonic_ns()
        stamp_ns = _stamp(time_ns, now_ns)
        expires_ns = _expiry(omega, stamp_ns, time_to_live)
        with self._lock:
            sight = self._sight if isinstance(self._sight, TurnSight) else TurnSight()
            self._note(sight, sight.take(q, omega, stamp_ns), expires_ns, now_ns)
            _check_rates("angular_velocity", sight.rates, "rad/s")
            self._show(sight, now_ns)

    def follow(self, plan: pb.Plan, *, start_ns: int = 0) -> None:
        """Follow a plan in the earth frame; return at once.  Call :meth:`base` before.

        Args:
            plan: a result of :meth:`.Robot.plan` that the daemon still stores.
            start_ns: when it starts, :func:`time.monotonic_ns` of this machine; 0 for now.

        Raises:
            RequestError: the start is of another clock, or more than an hour away.
            UnknownNameError: the daemon no longer stores the plan.
            StateError: there was no sample of the base.
            StaleBaseError: the base is stale.
            OrientdError: tracking has ended.
        """
        check_stamp("start_ns", start_ns, time.monotonic_ns(), ahead=LONGEST_WAIT, ago=LONGEST_WAIT)
        if self._base is None:
            raise StateError("expected samples of the base first; without one, use robot.move")
        request = pb.GetPlanRequest(
            device=self._device, motion_id=plan.motion_id, sample_rate_hz=PLAN_RATE_HZ
        )
        samples = self._connection.ask(self._connection.stub.GetPlan, request).plan.samples
        rows = zip(*[iter(samples.q)] * 4, strict=True)
        qs = [(w, x, y, z) for w, x, y, z in rows]
        now_ns = time.monotonic_ns()
        with self._lock:
            self._show(PlanSight(samples.path_times, qs, start_ns or now_ns), now_ns)

    def base(
        self,
        q_world_base: object,
        *,
        angular_velocity: object = None,
        velocity_frame: Frame = "body",
        time_ns: int = 0,
        time_to_live: float = 0.2,
    ) -> None:
        """Add a sample of the base's orientation; return at once.

        From the first sample on, targets are in the earth frame: the device keeps pointing at them
        while the base turns.  Samples that are too old, out of order, not finite or not of unit
        norm are skipped.

        Args:
            q_world_base: orientation of the device's base frame in the earth frame, in a form that
                :meth:`.Tracking.aim` takes.
            angular_velocity: of the base, rad/s, as a gyroscope measures it.  ``None`` derives it
                from successive samples.
            velocity_frame: the frame of that velocity.
            time_ns: time of the sample, :func:`time.monotonic_ns` of this machine, at most 0.05 s
                ahead; 0 for now.
            time_to_live: age from which the base is stale, s.  Then the device comes to rest until
                a newer sample arrives.

        Raises:
            RequestError: an argument is malformed, or the angular velocities are in degrees/s.
            OrientdError: tracking has ended.
        """
        check_life("time_to_live", time_to_live)
        now_ns = time.monotonic_ns()
        stamp_ns = _stamp(time_ns, now_ns, ahead=AHEAD_BASE)
        life_ns = round(time_to_live * 1e9)
        q = _unit(orientation_of(q_world_base, "q_world_base"))
        omega = None if q is None else _body_rate(q, angular_velocity, velocity_frame)
        with self._lock:
            if self._base is None:
                self._base = turning()
            is_fresh = q is not None and stamp_ns + life_ns > now_ns
            if q is None or not is_fresh or not self._base.take(q, omega, stamp_ns):
                self._skipped_samples += 1
                _check_rates("angular_velocity", self._base.rates, "rad/s")
                return
            self._samples += 1
            self._base_life_ns = life_ns
            if self._sight is not None and self._sight.is_in_world:
                self._emit(self._sight, now_ns, may_skip=True)

    @property
    def base_report(self) -> BaseReport:
        """The stream of the base's orientation."""
        with self._lock:
            stamp_ns = self._base.time_ns if self._base is not None else 0
            counts, life_ns = (self._samples, self._skipped_samples), self._base_life_ns
        if not stamp_ns:
            return BaseReport(*counts, 0, math.inf, False, 0)
        age_ns = time.monotonic_ns() - stamp_ns
        return BaseReport(*counts, stamp_ns, age_ns * 1e-9, age_ns >= life_ns, stamp_ns + life_ns)

    def _point(
        self,
        point: Vector3,
        velocity: Vector3 | None,
        place: Vector3 | None,
        roll: Roll,
        frame: str,
        pointing_axis: Axis,
        time_ns: int,
        time_to_live: float,
    ) -> None:
        """Take a sample of a point, or of a direction if there is no *place*; send a target."""
        if roll != "least":
            _degrees(roll, "roll")
        if pointing_axis not in AXES:
            expected = f"expected one of {', '.join(get_args(Axis))}"
            raise RequestError("pointing_axis", f"{expected}, got {pointing_axis!r}; give one")
        found, now_ns = self._frame(frame), time.monotonic_ns()
        stamp_ns, kind = _stamp(time_ns, now_ns), (frame, pointing_axis, place is None)
        expires_ns = _expiry(velocity, stamp_ns, time_to_live)
        with self._lock:
            sight = self._sight
            if not isinstance(sight, PointSight) or sight.kind != kind:
                sight = PointSight(
                    norm(plus(point, place or ZERO, -1.0)),
                    kind=kind,
                    q_base=found.base.q,
                    q_flange_axis=multiply(found.tool.q, AXES[pointing_axis]),
                )
            sight.roll, sight.place = roll, place or ZERO
            self._note(sight, sight.take(point, velocity, stamp_ns), expires_ns, now_ns)
            if place is None:
                _check_rates("azimuth_rate, elevation_rate", sight.rates, "degrees/s")
            else:
                _check_rates("velocity", sight.rates, "m/s")
            self._show(sight, now_ns)

    def _note(self, sight: Sight, is_newer: bool, expires_ns: int | None, now_ns: int) -> None:
        """Note until when a sample counts; count one from which nothing follows."""
        if is_newer:
            sight.expires_ns = expires_ns
        if not is_newer or (expires_ns is not None and expires_ns <= now_ns):
            self.skipped += 1

    def _frame(self, name: str) -> NamedFrame:
        """Return a frame of the device's configuration.

        Raises:
            RequestError: there is no such frame.
        """
        if not name:
            return NamedFrame()
        if self._frames is None:
            self._frames = self._configured()
        if name not in self._frames:
            near = did_you_mean(name, list(self._frames))
            step = near or "; define it in `frames` of the device"
            raise RequestError("frame", f"the device has no frame {name!r}{step}")
        return self._frames[name]

    def _configured(self) -> dict[str, NamedFrame]:
        from orientd.model.reading import read_frames

        stub = self._connection.stub
        answer = self._connection.ask(stub.GetConfiguration, pb.GetConfigurationRequest())
        devices = json.loads(answer.json)["devices"]
        name = self._device or next(iter(devices))
        return read_frames(devices[name].get("frames") or {})

    def _show(self, sight: Sight, now_ns: int) -> None:
        """Point at *sight* from now on.

        Raises:
            StaleBaseError: the base is stale.
        """
        self._sight = sight
        base = self._base
        if sight.is_in_world and base is not None:
            age_ns = now_ns - base.time_ns
            if not base.time_ns or age_ns >= self._base_life_ns:
                raise StaleBaseError(base.time_ns, now_ns, self._base_life_ns)
        self._emit(sight, now_ns, may_skip=False)

    def _emit(self, sight: Sight, now_ns: int, *, may_skip: bool) -> None:
        """Send a target for the time at which the next sample will have been sent."""
        least_ns = self._stamp_ns + SPACING_NS
        stamp_ns = now_ns + round(SPARE * self._gap_ns + self.transport * 1e9)
        if may_skip and stamp_ns < least_ns:
            # Of samples that arrive together the newest one counts, in place of the last target.
            if self._base is None or self._base.time_ns - self._used_ns < SPACING_NS:
                return
            stamp_ns = self._stamp_ns
        elif stamp_ns < least_ns - MOST_AHEAD_NS:
            return
        else:
            stamp_ns = max(stamp_ns, least_ns)
        gap_ns, self._emitted_ns = now_ns - self._emitted_ns, now_ns
        if gap_ns < LONGEST_NS:
            self._gap_ns += (USUAL if self._gap_ns else 1.0) * (gap_ns - self._gap_ns)
        turned, omega_base, expires = IDENTITY, ZERO, [sight.expires_ns]
        if sight.is_in_world and self._base is not None:
            turned, omega_base = self._base.at(stamp_ns)
            self._used_ns = self._base.time_ns
            expires.append(self._base.time_ns + self._base_life_ns)
        if self._target is None:
            q_before = to_quaternion(self.report.q)
            last = multiply(turned, q_before)
        elif sight.is_in_world:
            last = multiply(*self._target)
        else:
            last = self._target[1]
        q, omega = sight.at(stamp_ns, last)
        q = normalize(multiply(conjugate(turned), q))
        omega = plus(omega, rotate_back(q, omega_base), -1.0)
        rest_ns = REST_NS if omega == ZERO else LONGEST_NS
        known = [one for one in expires if one is not None]
        life_ns = min(known) - stamp_ns if known else rest_ns
        if life_ns <= 0:
            return
        self._target, self._stamp_ns = (turned, q), stamp_ns
        self.hand_over(
            pb.TrackTarget(
                orientation=quaternion(q),
                angular_velocity=vector(omega),
                velocity_frame=pb.FRAME_BODY,
                time_ns=stamp_ns,
                time_to_live=min(life_ns, REST_NS) / 1e9,
            )
        )


def _optional(given: object, name: str) -> Vector3 | None:
    return None if given is None else _finite(vector_of(given, name), name)


def _finite(given: Vector3, name: str) -> Vector3:
    """Return three numbers.

    Raises:
        RequestError: one is not finite.
    """
    if not all(map(math.isfinite, given)):
        raise RequestError(name, f"expected finite numbers, got {given}; leave out this sample")
    return given


def _degrees(given: float, name: str) -> float:
    """Return an angle in rad.

    Raises:
        RequestError: it is not a finite number.
    """
    if not isinstance(given, int | float) or not math.isfinite(given):
        raise RequestError(name, f"expected degrees, got {given!r}; give a finite number")
    return math.radians(given)


def _unit(q: Quaternion) -> Quaternion | None:
    """Return *q* with norm 1; ``None`` if its norm is off by more than rounding."""
    size = math.sqrt(sum(x * x for x in q)) if all(map(math.isfinite, q)) else 0.0
    return normalize(q) if abs(size - 1.0) <= NORM_TOLERANCE else None


def _body_rate(q: Quaternion, given: object, frame: Frame) -> Vector3 | None:
    """Return an angular velocity in the frame of *q*.

    Raises:
        RequestError: it is malformed.
    """
    omega, is_world = _optional(given, "angular_velocity"), is_in_world(frame)
    return rotate_back(q, omega) if omega is not None and is_world else omega


def _check_rates(place: str, rates: RateCheck, unit: str) -> None:
    """Check that the rates of samples are not degrees in place of radians, or the reverse.

    Raises:
        RequestError: they are.
    """
    if rates.ratio != 1.0:
        problem = f"expected {unit}, got {rates.ratio:.3g} times the change of the samples"
        raise RequestError(place, f"{problem}; convert it between degrees and radians")


def _stamp(time_ns: int, now_ns: int, ahead: float = AHEAD) -> int:
    """Return the time of a sample, which may be *ahead* of now, s.

    Raises:
        RequestError: it is no time, of another clock, or too far ahead or ago.
    """
    check_stamp("time_ns", time_ns, now_ns, ahead=ahead)
    return time_ns or now_ns


def _expiry(velocity: Vector3 | None, stamp_ns: int, time_to_live: float) -> int | None:
    """Return the time from which a sample no longer counts; ``None`` for a target at rest.

    Raises:
        RequestError: the time to live is out of range.
    """
    check_life("time_to_live", time_to_live)
    return None if velocity is None or velocity == ZERO else stamp_ns + round(time_to_live * 1e9)
