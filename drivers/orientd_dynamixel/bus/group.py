"""The cyclic read of all servos: asked for in one cycle, taken in the next, never waited for.

An answer that is not there yet is taken in a later cycle; meanwhile goals are sent and nothing is
asked.  One that has not come after the adapter's latency is lost, and the last good one grows old.
A late answer must never pass for the answer to a later question, which the protocol itself cannot
tell, so three things stand in its way: nothing is asked until the slowest answer would have come,
and what came is thrown away; the order in which servos answer changes from request to request; and
each block holds the servo's clock, which shows when it was measured.

Now and then a block is asked for that holds voltage and temperature as well: three bytes more of
each servo, in the place of the same question, so that no cycle waits for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from orientd.errors import DeviceFaultError, FeedbackError, LinkError
from orientd_dynamixel.axis import Axis
from orientd_dynamixel.bus.reading import (
    BLOCK,
    HEALTH,
    REALTIME_TICK,
    TICK_RANGE,
    Health,
    Reading,
    behind_ms,
    decode,
    decode_health,
)
from orientd_dynamixel.bus.servo_bus import ALERT, PATIENT_ATTEMPTS, ServoBus
from orientd_dynamixel.options import GimbalOptions

STALE_MS = 8.0
"""A block measured so much before it was asked for answers an earlier question."""
DRIFT = 0.01
"""How much faster than ours a servo's clock may run."""
_SOUNDINGS = 3
_TAIL_MS = 1.0
"""Stuffing makes an answer longer than it must be; its last bytes are this close behind."""
TAIL_SHARE = 0.2
"""Of the period, the most that a cycle waits for them."""
_BUSY_SHARE = 0.8
HEALTH_NS = 500_000_000
"""From one look at the servos' health to the next."""


@dataclass(slots=True)
class Losses:
    """What was not answered.

    Attributes:
        total: group reads so far that failed.
        in_a_row: since the last good one.
        culprits: by servo id, how often it was the first one missing since then.
    """

    total: int
    in_a_row: int
    culprits: dict[int, int]


class ServoClock:
    """What a servo's millisecond clock says, seen from here.

    Between a question and its measurement passes some time, never less than none, so the reading
    that lies farthest behind the question is the one to go by.  The two clocks may drift apart.
    """

    def __init__(self) -> None:
        self._asked_ns = 0
        self._tick_ms = -1.0

    def behind_ms(self, asked_ns: int, tick_ms: int) -> float:
        """Return by how much *tick_ms* is behind what a prompt answer would show, at least."""
        if self._tick_ms < 0.0:
            return 0.0
        elapsed_ms = (asked_ns - self._asked_ns) * 1e-6
        return behind_ms(tick_ms, (self._tick_ms + elapsed_ms) % TICK_RANGE)

    def learn(self, asked_ns: int, tick_ms: int) -> None:
        """Take a believed reading into account."""
        behind = self.behind_ms(asked_ns, tick_ms)
        if self._tick_ms < 0.0 or behind >= 0.0:
            self._tick_ms = float(tick_ms)
        else:
            elapsed_ms = (asked_ns - self._asked_ns) * 1e-6
            drift_ms = min(-behind, DRIFT * elapsed_ms)
            self._tick_ms = (self._tick_ms + elapsed_ms + drift_ms) % TICK_RANGE
        self._asked_ns = asked_ns


class Group:
    """Read all servos once a cycle.

    Attributes:
        time_ns: when the newest good reading was asked for.
        restarted: by axis' place, in words, the servos that have started again; they are no longer
            asked.
        losses: what was not answered.
        health: by axis, as last asked for.
    """

    def __init__(
        self,
        bus: ServoBus,
        axes: Sequence[Axis],
        *,
        is_fast: bool,
        max_losses: int,
        quiet_ns: int,
        period_ns: int,
    ) -> None:
        self.time_ns = 0
        self.restarted: dict[int, str] = {}
        self._newest: dict[int, Reading] = {}
        self._tail_ms = min(_TAIL_MS, TAIL_SHARE * period_ns * 1e-6)
        self.losses = Losses(0, 0, {})
        self._bus = bus
        self._axes = list(axes)
        self._is_fast = is_fast
        self._max_losses = max_losses
        self._quiet_ns = quiet_ns
        self.health: tuple[Health, ...] = ()
        self._turn = 0
        self._rows: list[tuple[int, int, int]] = []
        self._health_due_ns = 0
        self._asked_ns = 0
        self._is_waiting = False
        self._quiet_until_ns = 0
        self._clocks: dict[int, ServoClock] = {}
        self._set_orders()

    def _set_orders(self) -> None:
        """Set the orders in which those servos are asked that have not started again."""
        # Neighbours in this list differ, so that two requests in a row are never alike.
        self._orders = list(permutations(self.present))

    @property
    def present(self) -> list[int]:
        """Places of the axes whose servos have not started again."""
        return [place for place in range(len(self._axes)) if place not in self.restarted]

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The newest good readings by axis; empty before there is one of each."""
        if len(self._newest) < len(self._axes):
            return ()
        return tuple(self._newest[place] for place in range(len(self._axes)))

    @property
    def is_waiting(self) -> bool:
        """Whether an answer is on its way."""
        return self._is_waiting

    @property
    def cycle_bytes(self) -> int:
        """Bytes on the line each cycle: goals out, request out, answers in."""
        count = len(self._axes)
        return 14 + 5 * count + 14 + count + self._answer_bytes(count, len(BLOCK))

    def _answer_bytes(self, count: int, block: int) -> int:
        """Return the bytes of the answers of *count* servos, where each has a *block* to say."""
        return 8 + count * (block + 4) if self._is_fast else count * (block + 11)

    def can_ask(self, now_ns: int) -> bool:
        """Whether no answer is on its way nor may still come, and there is somebody to ask."""
        return not self._is_waiting and now_ns >= self._quiet_until_ns and bool(self.present)

    def ask(self, now_ns: int, alone: int | None = None) -> None:
        """Ask for the next reading, unless an answer is on its way or may still come.

        Args:
            now_ns: the time.
            alone: place of the only axis to ask; ``None`` for all.
        """
        if not self.can_ask(now_ns):
            return
        self._turn = (self._turn + 1) % len(self._orders)
        size = len(BLOCK) + (len(HEALTH) if now_ns >= self._health_due_ns else 0)
        order = self._orders[self._turn] if alone is None else (alone,)
        told = [self._axes[place].options for place in order]
        self._rows = [(one.id, one.model.indirect_data, size) for one in told]
        self._bus.request(self._rows, is_fast=self._is_fast)
        self._asked_ns = now_ns
        self._is_waiting = True

    def take(self, now_ns: int) -> bool:
        """Take the answer in if it is there; return whether there is a new good reading of all.

        Raises:
            FeedbackError: too many were lost in a row.
        """
        if not self._is_waiting:
            return False
        rows = self._rows
        is_there = self._bus.available >= self._answer_bytes(len(rows), rows[0][2])
        if not is_there and now_ns - self._asked_ns < self._quiet_ns:
            return False
        self._is_waiting = False
        blocks, missing = self._bus.collect(
            rows, self._tail_ms if is_there else 0.0, is_fast=self._is_fast
        )
        if len(blocks) < len(rows):
            self._lose(now_ns, missing, "no whole answer")
            return False
        for block in blocks:
            if block.error & ~ALERT:
                self._lose(now_ns, block.id, f"error {block.error & ~ALERT} instead of a reading")
                return False
        found = {block.id: decode(block.content[: len(BLOCK)]) for block in blocks}
        readings = {
            p: found[a.options.id] for p, a in enumerate(self._axes) if a.options.id in found
        }
        for place, reading in readings.items():
            if not reading.has_map:
                self._leave_out(place)
                return False
        for place, reading in readings.items():
            if problem := self._doubt(self._axes[place], reading):
                self._lose(now_ns, self._axes[place].options.id, problem)
                return False
        for place, reading in readings.items():
            axis = self._axes[place]
            axis.believe(reading.position, self._asked_ns)
            self._clocks[axis.options.id].learn(self._asked_ns, reading.tick_ms)
        self._newest.update(readings)
        if len(readings) < len(self.present):
            return False
        self.time_ns = self._asked_ns
        self.losses.in_a_row = 0
        self.losses.culprits.clear()
        if rows[0][2] > len(BLOCK):
            self._health_due_ns = self._asked_ns + HEALTH_NS
            said = {block.id: block.content[len(BLOCK) :] for block in blocks}
            if len(said) == len(self._axes):
                self.health = tuple(
                    decode_health(said[axis.options.id], self._asked_ns) for axis in self._axes
                )
        return bool(self.readings)

    def _leave_out(self, place: int) -> None:
        """Ask a servo no longer that has started again: what it says is not its position."""
        options = self._axes[place].options
        self.restarted[place] = (
            f"servo {options.id} ({options.name}) has started again and lost its settings; was its "
            "supply interrupted?"
        )
        self._turn = 0
        self._set_orders()

    def settle(self, now_ns: int, wait_ms: float) -> None:
        """Get the line free for single questions: take or await what is on its way."""
        if self._is_waiting:
            self._is_waiting = False
            self._bus.collect(self._rows, wait_ms, is_fast=self._is_fast)
        self._quiet_until_ns = now_ns
        self._bus.clear()

    def forget(self) -> None:
        """Begin anew: nothing read so far counts."""
        self._newest.clear()
        self.losses.in_a_row = 0
        self.losses.culprits.clear()
        self._is_waiting = False
        self._quiet_until_ns = 0

    def synchronise(self, now_ns: Callable[[], int]) -> None:
        """Learn what every servo's clock says, by asking each a few times alone.

        Raises:
            LinkError: one does not answer.
        """
        for axis in self._axes:
            servo = axis.options.id
            clock = ServoClock()
            for _ in range(_SOUNDINGS):
                asked_ns = now_ns()
                clock.learn(
                    asked_ns, self._bus.read(servo, REALTIME_TICK, 2, attempts=PATIENT_ATTEMPTS)
                )
            self._clocks[servo] = clock

    def _doubt(self, axis: Axis, reading: Reading) -> str:
        """Return why a reading cannot be believed, or nothing."""
        name = axis.options.name
        late_ms = self._clocks[axis.options.id].behind_ms(self._asked_ns, reading.tick_ms)
        if late_ms > STALE_MS:
            return f"{name} answered an earlier question, {late_ms:.0f} ms old"
        problem = axis.doubt(
            reading.position, is_driven=reading.is_torque_on, now_ns=self._asked_ns
        )
        return f"{name} {problem}" if problem else ""

    def _lose(self, now_ns: int, servo: int | None, why: str) -> None:
        losses = self.losses
        losses.total += 1
        losses.in_a_row += 1
        if servo is not None:
            losses.culprits[servo] = losses.culprits.get(servo, 0) + 1
        # What is late must have come, and be thrown away, before anything is asked again.
        self._quiet_until_ns = self._asked_ns + self._quiet_ns
        if losses.in_a_row >= self._max_losses:
            age_ms = (now_ns - self.time_ns) * 1e-6 if self.time_ns else float("inf")
            text = f"{losses.in_a_row} readings lost in a row, the last good is {age_ms:.0f} ms old"
            raise FeedbackError(f"{text}{self._blame()}: {why}")

    def _blame(self) -> str:
        """Return which servo was missing, or that it was not one alone; nothing where none was."""
        culprits = self.losses.culprits
        worst = max(culprits, key=lambda key: culprits[key], default=None)
        if worst is None:
            return ""
        # Each request begins with another servo, so that a dead line is put down to all of them.
        if 2 * culprits[worst] <= sum(culprits.values()):
            ids = ", ".join(map(str, sorted(culprits)))
            return f"; of servos {ids} alike, so look at the line, its supply and the adapter"
        name = next(axis.options.name for axis in self._axes if axis.options.id == worst)
        return f"; most often servo {worst} ({name})"


def listen(
    bus: ServoBus,
    axes: Sequence[Axis],
    options: GimbalOptions,
    firmware: Mapping[int, int],
    period_ns: int,
) -> tuple[Group, list[str]]:
    """Return the group of all servos, read as quickly as they can, and what keeps it from more.

    Args:
        bus: theirs.
        axes: of the gimbal.
        options: of the deployment.
        firmware: of each servo, by its id.
        period_ns: of the cycle.

    Raises:
        DeviceFaultError: fast reads are asked for that a servo does not know.
        LinkError: the line is too slow for the rate.
    """
    old = [
        f"servo {axis.options.id} has firmware {firmware[axis.options.id]}, fast reads need "
        f"{axis.options.model.fast_firmware}"
        for axis in axes
        if firmware[axis.options.id] < axis.options.model.fast_firmware
    ]
    if old and options.fast_read == "on":
        raise DeviceFaultError("; ".join(old))
    group = Group(
        bus, axes, is_fast=not old and options.fast_read != "off",
        max_losses=options.max_losses, quiet_ns=round(options.latency_ms * 1e6),
        period_ns=period_ns,
    )  # fmt: skip
    need_ms = group.cycle_bytes * bus.byte_ms
    if need_ms > _BUSY_SHARE * period_ns * 1e-6:
        raise LinkError(
            f"a cycle takes {need_ms:.2f} ms on the line at {options.baud} baud, the period "
            f"is {period_ns * 1e-6:.2f} ms; lower the rate or set the servos to a higher "
            "line speed"
        )
    return group, old if options.fast_read == "auto" else []
