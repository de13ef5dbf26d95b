"""The device of a MAVLink gimbal: it follows the path of the setpoint."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from orientd.driver import IDENTITY
from orientd.errors import DaemonError, OrientdError
from orientd.floats import difference, norm
from orientd.protocol.values import to_quaternion, to_vector
from orientd_mavlink.ranges import Ranges
from orientd_mavlink.setpoint import RETRACT, STEP, Setpoint, Wish
from orientd_serving.served import Denials, Served, named

_POSES = 60
"""Poses of the path that the device has in advance: enough for the longest brake."""

_RENEWAL = 0.4
"""Time after which a moving device gets a longer path, s."""

_IDLE = 1.0
"""Time without a request after which a device at rest stops following, s."""

_BEHIND = 0.3
"""Angle from the setpoint at which a device counts as unable to follow a rate, rad."""

_LIFE = 60.0
"""How long a target counts, s; the device reaches it in this time or stops."""

_TURNED = 1e-6
"""Smallest turn of the setpoint that counts, rad."""

_AT_REST = 1e-6
"""Angular velocity of a device at rest, rad/s."""

_PATIENCE = 1.5
"""Longest time until a command is answered, s.  MAVSDK repeats one every 0.5 s, for 2 s."""

_USUAL = 0.2
"""Weight of the last gap between two messages of a stream in the usual one."""

_NO_HEADING = (
    "a yaw from north is denied: the heading is unknown; set --north, or let the autopilot send "
    "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE"
)

Done = Callable[[bool], None]
"""Called with whether a command is carried out."""


class Gimbal:
    """Moves the device to the setpoint, in the thread that calls :meth:`tick`.

    Planning and coming to rest may take longer, so they run in a thread of their own.

    Attributes:
        setpoint: of the gimbal.
        ranges: of its angles and rates; it announces them and keeps them.
        knows_north: whether the heading of the base is known.
        deny: warns of a problem, but not again and again: a stream repeats its mistake.
        problem: the error because of which the device does not move; empty if there is none.
    """

    def __init__(
        self,
        served: Served,
        options: Mapping[str, Any],
        north: float | None,
        warn: Callable[[str], None],
    ) -> None:
        """Move the device only when asked.

        Args:
            served: the device.
            options: of its driver.
            north: heading of the base, rad; ``None`` if it is unknown.
            warn: called with each problem, in one line.
        """
        limits = served.report().limits
        self.ranges = Ranges.of_device(options, limits.velocity)
        # The other half of the acceleration is for corrections.
        self.setpoint = Setpoint(
            north or 0.0,
            speed=limits.velocity,
            acceleration=0.5 * limits.acceleration,
        )
        self.knows_north, self.problem = north is not None, ""
        self._served, self.deny = served, Denials(warn)
        self._threads = ThreadPoolExecutor(1, "orientd mavlink")
        self._job: Future[object] | None = None
        self._done: Done | None = None
        self._is_tracking = self._is_turned = False
        self._done_by = self._asked = self._turns_until = self._renewal = -math.inf
        self._gap, self._streamed = 0.0, -math.inf
        self._ticked = math.inf

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
        """Return whether a request is valid and within the ranges; otherwise warn of it.

        A request that needs north is invalid while north is unknown.
        """
        needs_north = wish.needs_heading and not self.knows_north
        problem = wish.problem or (_NO_HEADING if needs_north else "")
        problem = problem or self.ranges.problem(wish, self.setpoint.base[2])
        if problem:
            self.deny(problem)
        return not problem

    def plan(self, wish: Wish, done: Done) -> None:
        """Move to the requested angles in one motion, which is planned as a whole.

        To retract turns all axes back to zero, which also unwinds their turns.
        """
        if wish.flags & RETRACT:
            self._is_tracking, self.setpoint.flags = False, RETRACT
            self._run(
                lambda: self._served.move(
                    [named(IDENTITY)], device_options={"home": True}, name="home"
                ),
                done,
            )
            return
        self._take(wish)
        self.setpoint.settle()
        q = named(self.setpoint.orientation())
        self._run(lambda: self._served.move([q], approach=True), done)

    def take(self, wish: Wish, *, life: float) -> None:
        """Follow a request from now on.

        Args:
            wish: the request.
            life: how long its rates count, s; infinity for a command, others are of a stream.
        """
        if wish.flags & RETRACT:
            if not self.setpoint.flags & RETRACT:
                self.plan(wish, lambda _: None)
            return
        now = time.monotonic()
        gap, self._streamed = now - self._streamed, now
        if life == math.inf or gap > life:
            self._gap = 0.0
        else:
            self._gap += (_USUAL if self._gap else 1.0) * (gap - self._gap)
        self._take(wish, self._gap)
        self._turns_until = now + life
        self._track()

    def turn_base(self, base: Sequence[float]) -> None:
        """Keep the setpoint where its flags say while the base turns.

        Args:
            base: roll, pitch and heading in the earth frame, rad.
        """
        before = self.setpoint.orientation()
        self.setpoint.base, self.knows_north = base, True
        turned = difference(before, self.setpoint.orientation())
        is_ours = self._served.robot.holds_lease(self._served.name)
        if norm(turned) > _TURNED and is_ours and not self.setpoint.flags & RETRACT:
            self._track()
            self._is_turned = True

    def rest(self) -> None:
        """Let every angle that turns at a rate come to rest."""
        if self.setpoint.rest():
            self._renewal = -math.inf

    def tick(self) -> None:
        """Send the next part of the path if it is due, and answer commands that are carried out.

        Raises:
            DaemonError: the daemon is lost.
        """
        if self._job is not None:
            if not self._job.done():
                if time.monotonic() > self._done_by:
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
                self._follow()
            except OrientdError as error:
                self._is_tracking = False
                self._check(error)

    def close(self) -> None:
        """Return when no command runs any more."""
        self._threads.shutdown(cancel_futures=True)

    def _stand(self) -> None:
        self.setpoint.begin(to_quaternion(self._served.report().cycle.q))

    def _take(self, wish: Wish, gap: float = 0.0) -> None:
        if self.setpoint.flags & RETRACT:
            self._stand()
        self.setpoint.take(wish, gap)

    def _track(self) -> None:
        if not self._is_tracking:
            self._is_tracking, self._ticked = True, math.inf
        self._asked, self._renewal = time.monotonic(), -math.inf

    def _follow(self) -> None:
        """Give the device the next part of the path; stop following once it has rested a while."""
        setpoint, tracking = self.setpoint, self._served.track()
        # The path does not move on while a session begins.
        now = time.monotonic()
        seconds, self._ticked = min(now - self._ticked, _POSES * STEP), now
        setpoint.advance(max(seconds, 0.0))
        self.problem = ""
        apart = difference(setpoint.orientation(), to_quaternion(tracking.report.q))
        if now > self._turns_until or norm(apart) > _BEHIND:
            self.rest()
        if self._is_turned and not setpoint.is_moving:
            # The servo derives the velocity of the base from one target to the next.
            tracking.aim(named(setpoint.orientation()), time_to_live=_LIFE)
            self._renewal = math.inf
        elif now > self._renewal:
            poses = [named(q) for q in setpoint.ahead(_POSES)]
            tracking.chunk(poses, rate=1.0 / STEP, start=now)
            self._renewal = now + _RENEWAL if setpoint.is_moving else math.inf
        self._is_turned = False
        if setpoint.is_moving:
            self._asked = now
        elif now - self._asked > _IDLE and norm(to_vector(tracking.report.omega_body)) < _AT_REST:
            # The next command can be planned as a whole again.
            self._is_tracking = False
            self._run(self._served.end_tracking)

    def _run(self, work: Callable[[], object], done: Done | None = None) -> None:
        self._answer(is_done=True)
        self._done, self._done_by = done, time.monotonic() + _PATIENCE
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
        if self.problem:
            self.deny(self.problem)

    def _release(self) -> None:
        self._served.rest()
        self._served.robot.release_lease(self._served.name)
