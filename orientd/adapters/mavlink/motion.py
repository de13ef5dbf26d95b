"""The motion of a MAVLink gimbal: one setpoint, followed by targets or reached by a motion."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

from orientd.adapters.mavlink.setpoint import RETRACT, Base, Setpoint, Wish
from orientd.adapters.served import Served
from orientd.driver import IDENTITY
from orientd.driver import Quaternion as Components
from orientd.errors import DaemonError, OrientdError
from orientd.floats import difference, norm
from orientd.protocol import to_quaternion, to_vector
from orientd.rotation import Quaternion

LIFE = 0.15
"""How long a target of a turning gimbal counts, s."""

LONG_LIFE = 60.0
"""How long the last target counts, s; the device reaches it in this time or stops."""

IDLE = 1.0
"""Time without a request after which a device at rest stops following, s."""

BEHIND = 0.3
"""Angle from the target at which a device counts as unable to follow a rate, rad."""

_TURNED = 1e-6
"""Smallest turn of the setpoint that counts, rad."""

AT_REST = 1e-6
"""Angular velocity of a device at rest, rad/s."""

PATIENCE = 1.5
"""Longest time until a command is answered, s.  MAVSDK repeats one every 0.5 s, for 2 s."""

_NO_HEADING = (
    "a yaw from north is denied: the heading is unknown; set --north, or let the autopilot send "
    "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE"
)

Done = Callable[[bool], None]
"""Called with whether a command is carried out."""


class GimbalMotion:
    """Moves the device to the setpoint, in the thread that calls :meth:`tick`.

    Planning and coming to rest may take longer, so they run in a thread of their own.

    Attributes:
        setpoint: of the gimbal.
        base: the attitude of its base.
        limits: of the device.
        problem: the error because of which the device does not move; empty if there is none.
    """

    def __init__(self, served: Served, base: Base, warn: Callable[[str], None]) -> None:
        """Move the device only when asked.

        Args:
            served: the device.
            base: the attitude of its base, until another is known.
            warn: called with each problem, in one line.
        """
        self.limits = served.report().limits
        # The other half is for corrections.
        self.setpoint = Setpoint(0.5 * self.limits.acceleration)
        self.base, self.problem, self._told = base, "", ""
        self._served, self._warn = served, warn
        self._threads = ThreadPoolExecutor(1, "orientd mavlink")
        self._job: Future[object] | None = None
        self._done: Done | None = None
        self._done_by = self._asked = self._turns_until = -math.inf
        self._is_tracking = self._is_new = self._is_last = False
        self._ticked = time.monotonic()

    @property
    def is_idle(self) -> bool:
        """Whether the next command can be planned as a whole: nothing is followed or planned."""
        return self._job is None and not self._is_tracking

    def begin(self) -> None:
        """Take the lease, and let the setpoint be where the device is commanded to be.

        Raises:
            OrientdError: another client holds the lease.
        """
        self._served.robot.acquire_lease(self._served.name)
        self._stand()

    def end(self) -> None:
        """Come to rest, and release the lease."""
        self._is_tracking = False
        self._run(self._release)

    def can(self, wish: Wish) -> bool:
        """Return whether a request is valid, and north is known if it needs that."""
        if wish.needs_heading and self.base.heading is None:
            self._tell(_NO_HEADING)
            return False
        return wish.is_valid

    def plan(self, wish: Wish, done: Done) -> None:
        """Move to the requested angles in one motion, which is planned as a whole.

        To retract turns all axes back to zero, which also unwinds their turns.
        """
        if wish.flags & RETRACT:
            self._is_tracking, self.setpoint.flags = False, RETRACT
            self._run(self._retract, done)
            return
        self._take(wish)
        self.setpoint.advance(0.0)
        q = _named(self.setpoint.orientation(self.base))
        self._run(lambda: self._served.move([q], approach=True), done)

    def take(self, wish: Wish, *, life: float, is_stream: bool) -> None:
        """Follow what is asked from now on.

        Args:
            wish: the request.
            life: how long its rates count, s.
            is_stream: whether others follow it soon; else the device rests at its angles.
        """
        if wish.flags & RETRACT:
            if not self.setpoint.flags & RETRACT:
                self.plan(wish, lambda _: None)
            return
        self._take(wish)
        self._turns_until = time.monotonic() + life
        self._track(is_last=not is_stream)

    def turn_base(self, base: Base) -> None:
        """Keep the setpoint where its flags say while the base turns."""
        before, self.base = self.setpoint.orientation(self.base), base
        turned = norm(difference(before, self.setpoint.orientation(base)))
        is_ours = self._served.robot.holds_lease(self._served.name)
        if turned > _TURNED and is_ours and not self.setpoint.flags & RETRACT:
            self._track(is_last=False)

    def lose_heading(self) -> None:
        """Know no longer where north is."""
        self.base = replace(self.base, heading=None)

    def rest(self) -> None:
        """Let what turns at a rate come to rest."""
        self.setpoint.rest()

    def tick(self) -> None:
        """Send the next target if one is due, and answer commands that are carried out.

        Raises:
            DaemonError: the daemon is lost.
        """
        now = time.monotonic()
        seconds, self._ticked = min(now - self._ticked, 0.1), now
        if self._job is not None:
            if not self._job.done():
                if now > self._done_by:
                    self._answer(is_done=True)
                return
            job, self._job = self._job, None
            error = job.exception()
            self._check(error)
            if error is not None and not self._is_tracking:
                self._stand()
            self._answer(is_done=error is None)
        if self._is_tracking:
            try:
                self._follow(seconds, now)
            except OrientdError as error:
                self._is_tracking = False
                self._check(error)

    def close(self) -> None:
        """Return when no command runs any more."""
        self._threads.shutdown(cancel_futures=True)

    def _stand(self) -> None:
        self.setpoint.begin(to_quaternion(self._served.report().cycle.q), self.base)

    def _take(self, wish: Wish) -> None:
        if self.setpoint.flags & RETRACT:
            self._stand()
        self.setpoint.take(wish, self.base)

    def _track(self, *, is_last: bool) -> None:
        self._asked = time.monotonic()
        self._is_tracking = self._is_new = True
        self._is_last = is_last

    def _follow(self, seconds: float, now: float) -> None:
        setpoint, tracking = self.setpoint, self._served.track()
        self.problem = ""
        if now > self._turns_until:
            setpoint.rest()
        was_moving = setpoint.is_moving
        setpoint.advance(seconds, is_behind=tracking.report.error > BEHIND)
        target = _named(setpoint.orientation(self.base))
        if setpoint.is_moving:
            omega = setpoint.omega_body()
            tracking.aim(target, angular_velocity=omega, time_to_live=LIFE)
        elif was_moving or self._is_new:
            stands = was_moving or self._is_last
            rest = (0.0, 0.0, 0.0) if stands else None
            tracking.aim(target, angular_velocity=rest, time_to_live=LONG_LIFE)
            self._asked = now
        elif now - self._asked > IDLE and norm(to_vector(tracking.report.omega_body)) < AT_REST:
            # The next command can be planned as a whole again.
            self._is_tracking = False
            self._run(self._served.end_tracking)
        self._is_new = False

    def _run(self, work: Callable[[], object], done: Done | None = None) -> None:
        self._answer(is_done=True)
        self._done, self._done_by = done, time.monotonic() + PATIENCE
        self._job = self._threads.submit(work)
        self._asked = time.monotonic()

    def _answer(self, *, is_done: bool) -> None:
        done, self._done = self._done, None
        if done is not None:
            done(is_done)

    def _check(self, error: BaseException | None) -> None:
        """Report an error of the device.

        Raises:
            DaemonError: the daemon is lost.
        """
        if isinstance(error, DaemonError) or not isinstance(error, OrientdError | None):
            raise error
        self.problem = "" if error is None else str(error)
        self._tell(self.problem)

    def _tell(self, problem: str) -> None:
        """Warn of a problem, but not again and again: a stream repeats its mistake."""
        if problem and problem != self._told:
            self._told = problem
            self._warn(problem)

    def _retract(self) -> None:
        self._served.move([_named(IDENTITY)], device_options={"home": True}, name="home")

    def _release(self) -> None:
        self._served.rest()
        self._served.robot.release_lease()


def _named(q: Components) -> Quaternion:
    w, x, y, z = q
    return Quaternion(w=w, x=x, y=y, z=z)
