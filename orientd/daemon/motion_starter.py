"""Begin motions: planned in turn, begun in a thread, stopped again if nobody waits for them.

What a motion is planned from changes when another one begins: two that are planned side by side for
one device would each make the other come too late.  So one motion of a device at a time is planned
to be begun, in the order in which they came.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future, ThreadPoolExecutor

from orientd.daemon.device import Device
from orientd.daemon.leases import Lease
from orientd.daemon.motions import AT_ONCE, ActiveMotion, ActiveMotions, MoveOptions, Prepared
from orientd.daemon.observe import about
from orientd.daemon.planners import PlanCall, PlannedMotion
from orientd.errors import (
    DeadlineError,
    LateError,
    NotYetError,
    OrientdError,
    StartError,
    StateError,
)
from orientd.floats import difference, norm
from orientd.planner import Limits
from orientd.rpc import control_pb2 as pb
from orientd.rpc import titled
from orientd.stream import UNKNOWN

_log = logging.getLogger(__name__)

ATTEMPTS = 6
"""How often a motion is planned anew because the device has passed where it was to begin."""

START_TOLERANCE = 1e-6
"""How far from where the device is commanded to be a kept plan may begin, rad and m."""

GONE = "its caller has gone away"


class MotionStarter:
    """Begins motions for whoever holds the lease."""

    def __init__(
        self,
        runs: ActiveMotions,
        commanders: ThreadPoolExecutor,
        *,
        check: Callable[[str, Device], Lease],
        is_held: Callable[[str, str], bool],
    ) -> None:
        """Begin none yet.

        Args:
            runs: takes note of them.
            commanders: threads in which devices are waited for.
            check: returns the lease of a token and a device, or raises what is wrong with it.
            is_held: whether a token is still that of a lease of a device, by its name.
        """
        self._runs = runs
        self._commanders = commanders
        self._check = check
        self._is_held = is_held
        self._turns: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    async def move(
        self,
        token: str,
        device: Device,
        order: PlanCall,
        move_options: MoveOptions = AT_ONCE,
        *,
        stops: int,
        received_ns: int,
    ) -> tuple[ActiveMotion, pb.MoveTiming]:
        """Plan what *order* asks of *device*, and begin it.

        A motion that runs is replaced from a point a little ahead, or followed.  If whoever asks
        goes away meanwhile, it is stopped again.

        Args:
            token: the lease.
            device: what is to move.
            order: what it is to do.
            move_options: how to begin and to end.
            stops: what :meth:`ActiveMotions.stops` returned when the motion was asked for.
            received_ns: when that was, monotonic clock.

        Raises:
            RequestError: it is not well formed.
            LeaseError: *token* is not that of the lease.
            StateError: the device is not ready to move, or was stopped meanwhile.
            PlanError: it cannot be planned, or would break a limit.
        """
        try:
            async with self._turn(device.name, order):
                return await self._move(token, device, order, move_options, stops, received_ns)
        except OrientdError as error:
            error.waiting = sum(order.waits)
            raise

    async def _move(
        self,
        token: str,
        device: Device,
        order: PlanCall,
        move_options: MoveOptions,
        stops: int,
        received_ns: int,
    ) -> tuple[ActiveMotion, pb.MoveTiming]:
        attempt, late = 0, ""
        while attempt < ATTEMPTS and order.time_left:
            try:
                prepared = await device.prepare(order, move_options, attempt=attempt)
                planned_ns = time.monotonic_ns()
                run = await self._begin(token, device, prepared, stops=stops)
            except NotYetError as error:
                late = str(error)
                with order.waiting():
                    await device.await_steady()
            except LateError as error:
                _log.info("%s: planned too late: %s", device.name, error)
                attempt, late = attempt + 1, str(error)
            else:
                timing = pb.MoveTiming(
                    planning=(planned_ns - received_ns) * 1e-9,
                    splicing=(time.monotonic_ns() - planned_ns) * 1e-9,
                    received_ns=received_ns,
                    attempts=attempt + 1,
                    waiting=sum(order.waits),
                )
                return run, timing
        raise StateError(f"device {device.name} was too quick for {attempt} plans: {late}")

    @contextlib.asynccontextmanager
    async def _turn(self, device: str, order: PlanCall) -> AsyncIterator[None]:
        """Wait until it is the turn of *order*, and keep the turn for as long as the context lasts.

        Raises:
            DeadlineError: what was asked for before takes too long.
        """
        lock = self._turns[device]
        try:
            with order.waiting():
                async with asyncio.timeout(order.time_left):
                    await lock.acquire()
        except TimeoutError:
            raise DeadlineError(
                f"planning did not begin within {order.timeout:g} s: device {device} is being "
                "given motions that were asked for before"
            ) from None
        try:
            yield
        finally:
            lock.release()

    async def start(
        self,
        token: str,
        device: Device,
        motion: PlannedMotion,
        move_options: MoveOptions = AT_ONCE,
        *,
        stops: int,
    ) -> ActiveMotion:
        """Begin to run *motion*, a kept plan, on a device at rest.

        Args:
            token: the lease.
            device: what is to move.
            motion: planned for it.
            move_options: how to begin and to end.
            stops: what :meth:`ActiveMotions.stops` returned when the motion was asked for.

        Raises:
            LeaseError: *token* is not that of the lease.
            StateError: the device is not at rest, ready to move, or was stopped meanwhile.
            StartError: the motion does not begin where the device is commanded to be.
        """
        check_start(device, motion)
        return await self._begin(
            token, device, Prepared(motion, move_options=move_options), stops=stops
        )

    async def _begin(
        self, token: str, device: Device, prepared: Prepared, *, stops: int
    ) -> ActiveMotion:
        """Begin a motion in a thread; if whoever asks goes away meanwhile, stop it again."""
        beginning = self._commanders.submit(
            self._run,
            token,
            device,
            lambda: device.start(prepared),
            motion=prepared.motion,
            stops=stops,
            start_ns=prepared.move_options.start_ns,
        )
        try:
            return await asyncio.shield(asyncio.wrap_future(beginning))
        except asyncio.CancelledError:
            beginning.add_done_callback(self._abandon_begun)
            raise

    def _abandon_begun(self, beginning: Future[ActiveMotion]) -> None:
        if beginning.exception() is None:
            self._commanders.submit(self._runs.abandon, beginning.result(), GONE)

    def track(self, token: str, device: Device, limits: Limits, *, stops: int) -> ActiveMotion:
        """Have *device* follow targets from now on; see :meth:`Device.aim`.

        Args:
            token: the lease.
            device: what is to move.
            limits: narrower than the device's own; infinite ones are left to it.
            stops: what :meth:`ActiveMotions.stops` returned when this was asked for.

        Raises:
            RequestError: the limits are above the device's.
            LeaseError: *token* is not that of the lease.
            StateError: the device is not ready to move, or was stopped meanwhile.
        """
        return self._run(token, device, lambda: device.track(limits), motion=None, stops=stops)

    def _run(
        self,
        token: str,
        device: Device,
        start: Callable[[], int],
        *,
        motion: PlannedMotion | None,
        stops: int,
        start_ns: int = UNKNOWN,
    ) -> ActiveMotion:
        lease = self._check(token, device)
        run = self._runs.begin(
            device,
            start,
            motion=motion,
            token=token,
            stops=stops,
            is_owned=lambda: self._is_held(token, device.name),
            start_ns=start_ns,
        )
        name = motion.facts.name if motion is not None else ""
        _log.info(
            "%s: motion %s is commanded by %s",
            device.name,
            titled(run.number, name),
            lease.who,
            extra=about(
                device=device.name,
                motion=run.number,
                motion_id=motion.id if motion is not None else "",
                motion_name=name,
                identity=lease.owner,
                planned_duration=motion.facts.duration if motion is not None else None,
            ),
        )
        return run


def check_start(device: Device, motion: PlannedMotion) -> None:
    """Refuse *motion* unless it begins where *device*, at rest, is commanded to be.

    Raises:
        StateError: the device is not holding.
        StartError: the motion begins with another orientation, position or axis angles.
    """
    here, begin = device.commanded(), motion.state_at(0)
    turn = norm(difference(here.q.tolist(), begin.q.tolist()))
    if turn > START_TOLERANCE:
        raise StartError(
            f"the motion begins {turn:.6g} rad from where device {device.name!r} is commanded "
            f"to be; plan it again"
        )
    if not device.is_at(motion.facts.first_joints):
        raise StartError(
            f"the motion begins with other axis angles than those of device {device.name!r}; "
            "plan it again"
        )
    away = float(abs(here.position - begin.position).max())
    if away > START_TOLERANCE:
        raise StartError(
            f"the motion begins {away:.6g} m from where device {device.name!r} is commanded "
            f"to be; plan it again"
        )
