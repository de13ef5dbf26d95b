"""Take over from a motion under way, at a record of it from which the device's axes can go on."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import NamedTuple

from orientd.daemon.devices import ServoLink
from orientd.daemon.motions.motion_queue import MotionQueue
from orientd.daemon.motions.queued_motion import SplicePoint
from orientd.daemon.planners import PlanCall, PlanInput, PlannedMotion, Planners, Rank
from orientd.errors import LateError, LimitError, PlanError
from orientd.planner import State as PlannedState

_LATER_ATTEMPTS = 3
"""How often a later place on the way is tried: then what the driver shapes begins at rest."""

_LATER = ((0.0,), (0.0, 0.15), (0.0, 0.3))
"""How much later on the way is tried what cannot go on there, s.

A row is tried side by side, from where the device has come to while the one before was refused.
"""

Choose = Callable[[], Awaitable[SplicePoint | None]]


class Successor(NamedTuple):
    """A motion that takes over.

    Attributes:
        leave: where.
        motion: the motion.
        chosen: when that point was chosen, by the monotonic clock, s.
    """

    leave: SplicePoint
    motion: PlannedMotion
    chosen: float


class Takeover:
    """Plans the successors of one device's motions."""

    def __init__(
        self, link: ServoLink, name: str, planners: Planners, queue: MotionQueue, period: float
    ) -> None:
        """Plan for the device *name*, what takes over from motions of *queue*."""
        self._link, self._name, self._planners = link, name, planners
        self._queue, self._period = queue, period

    async def plan(
        self, order: PlanCall, leave: SplicePoint, choose: Choose, attempt: int
    ) -> Successor | None:
        """Plan a motion from *leave* on; ``None`` where it can be begun at rest only.

        Where nothing could go on from there, as axes in the midst of a passage near a singularity
        or a device that still gains speed just below its limit, it is tried a little later on the
        way.

        Args:
            order: what to do.
            leave: where to take over.
            choose: chooses anew, from where the device is by then; ``None`` where nothing runs.
            attempt: how often the servo has said already that it was too late.

        Raises:
            LateError: what it was to replace has ended.
            PlanError: it cannot be planned, at rest neither; nothing has changed.
        """
        chosen, left = time.monotonic(), self.left(leave)
        is_shaped = bool(left.joints_at(leave.record))
        rows = _LATER if attempt < _LATER_ATTEMPTS else () if is_shaped else _LATER[:1]
        refusal: PlanError | None = None
        for together in rows:
            ahead = [leave.record + round(seconds / self._period) for seconds in together]
            end = min(left.last_record, left.at_hand[1])
            records = [one for one in ahead if one < end or (one == leave.record and not is_shaped)]
            trials = [self._trial(order, left, record) for record in records]
            ended = await asyncio.gather(*trials, return_exceptions=True)
            found = {}
            for record, motion in zip(records, ended, strict=True):
                if isinstance(motion, PlannedMotion):
                    found[record] = motion
                elif isinstance(motion, PlanError):
                    refusal = refusal or motion
                else:
                    raise motion
            if found:
                record = min(filter(self._is_ahead(leave), found), default=max(found))
                return Successor(replace(leave, record=record), found[record], chosen)
            is_of_lead_in = isinstance(refusal, LimitError) and refusal.is_in_lead_in
            if refusal is not None and not (is_shaped or is_of_lead_in):
                raise refusal
            now = await choose()
            if now is None:
                return None
            leave, chosen, left = now, time.monotonic(), self.left(now)
        # What cannot be planned from rest near there is not worth a stop.
        state, joints = left.state_at(leave.record), left.joints_at(leave.record)
        rest = PlannedState.at_rest(state.q, state.position)
        await self._planners.plan(
            PlanInput(self._name, order.motion, start=rest, joints=joints), order
        )
        return None

    def left(self, leave: SplicePoint) -> PlannedMotion:
        """Return the motion to take over from.

        Raises:
            LateError: it has ended.
        """
        queued = self._queue.queued(leave.number)
        if queued is None:
            raise LateError(f"motion {leave.number} has ended")
        return queued.motion

    async def _trial(self, order: PlanCall, left: PlannedMotion, record: int) -> PlannedMotion:
        state, joints = left.state_at(record), left.joints_at(record)
        is_moving = bool(joints) and not state.is_at_rest
        plan_input = PlanInput(
            self._name,
            order.motion,
            start=state,
            joints=joints,
            before=left.joints_before(record) if is_moving else (),
            rates=left.joint_rates_at(record) if is_moving else (),
        )
        return await self._planners.plan(plan_input, order, rank=Rank.URGENT)

    def _is_ahead(self, leave: SplicePoint) -> Callable[[int], bool]:
        """Return whether the servo has yet to come to a record of the motion to leave."""
        cycle = self._link.newest()
        here = leave if cycle is None else self._queue.ahead(cycle, 0)
        return lambda record: here.number == leave.number and record > here.record
