"""The cyclic read of all servos: asked for in one cycle, taken in the next, never waited for.

An answer that is not there yet is taken in a later cycle; meanwhile goals are sent and nothing is
asked.  One that has not come after the adapter's latency is lost, and the last good one grows old.
The protocol cannot tell a late answer from the answer to a later question, so each block holds the
servo's clock, which shows when it was measured.  A position at which the servo cannot be counts as
lost, too.

Now and then a block is asked for that holds voltage and temperature as well: three bytes more of
each servo, in the place of the same question, so that no cycle waits for them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

from orientd.clock import Clock
from orientd.errors import DeviceFaultError, FeedbackError, LinkError
from orientd_dynamixel.bus import ALERT, PATIENT_ATTEMPTS, Block, Row
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.servo import Servo
from orientd_dynamixel.tables import RETURN_LEVEL, TICK_RANGE

STALE_MS = 8.0
"""A block measured so much before it was asked for answers an earlier question."""
DRIFT = 0.01
"""By how much a servo's clock may run faster or slower than ours."""
TAIL_SHARE = 0.2
"""Of the period, the most that a cycle waits for the last bytes of an answer."""
HEALTH_NS = 500_000_000
"""From one look at the servos' health to the next."""

_TAIL_MS = 1.0
"""Stuffing makes an answer longer than it must be; its last bytes are this close behind."""
_FLOOD = 2
"""So many times as many bytes as were asked for are noise."""
_SOUNDINGS = 3
_BUSY_SHARE = 0.8
_BLOCK = struct.Struct("<BBBBHhii")
_WHOLE = struct.Struct("<BBBBHhiiHB")
"""With health."""


class Reading(NamedTuple):
    """One block of one servo, in its own units.

    Attributes:
        torque: 1 if it drives.
        return_level: :data:`RETURN_LEVEL`, unless the servo has forgotten what it was asked for.
        hardware_error: its bits.
        watchdog: in units of 20 ms; 255 if it has tripped.
        tick: its clock, ms.
        current: in steps.
        velocity: in steps.
        position: ticks, unwrapped by the servo.
        voltage: in steps of 0.1 V; 0 if it was not asked for.
        temperature: degrees Celsius; 0 if it was not asked for.
    """

    torque: int
    return_level: int
    hardware_error: int
    watchdog: int
    tick: int
    current: int
    velocity: int
    position: int
    voltage: int = 0
    temperature: int = 0


def answer_bytes(count: int, *, is_fast: bool, size: int = _BLOCK.size) -> int:
    """Return how long the answers of *count* servos are, with *size* bytes of content each."""
    return 8 + count * (size + 4) if is_fast else count * (size + 11)


def cycle_bytes(count: int, *, is_fast: bool) -> int:
    """Return how many bytes a cycle takes: goals out, request out, answers in."""
    return 14 + 5 * count + 14 + count + answer_bytes(count, is_fast=is_fast)


def decode(content: bytes) -> Reading:
    """Return what the bytes of a block say, with health or without."""
    return Reading(*(_WHOLE if len(content) == _WHOLE.size else _BLOCK).unpack(content))


class ServoClock:
    """How a servo's millisecond clock lies to ours.

    Between a question and its measurement passes some time, never less than none, so the reading
    that lies farthest behind the question is the one to go by.  The two clocks may drift apart.
    """

    def __init__(self) -> None:
        self._offset_ms: float | None = None
        self._asked_ns = 0

    def behind_ms(self, asked_ns: int, tick: int) -> float:
        """Return by how much *tick* is behind what a prompt answer would show, at least."""
        return self._late_ms(asked_ns, tick) - self._drift_ms(asked_ns)

    def learn(self, asked_ns: int, tick: int) -> None:
        """Take a believed reading into account."""
        if self._offset_ms is None:
            self._offset_ms = asked_ns * 1e-6 - tick
        self._offset_ms += max(self._late_ms(asked_ns, tick), -self._drift_ms(asked_ns))
        self._asked_ns = asked_ns

    def _late_ms(self, asked_ns: int, tick: int) -> float:
        if self._offset_ms is None:
            return 0.0
        late = asked_ns * 1e-6 - tick - self._offset_ms
        return (late + TICK_RANGE / 2) % TICK_RANGE - TICK_RANGE / 2

    def _drift_ms(self, asked_ns: int) -> float:
        return DRIFT * (asked_ns - self._asked_ns) * 1e-6


class Group:
    """Read all servos once a cycle.

    Args:
        servos: of the gimbal, on one bus.
        is_fast: whether they know fast reads.
        max_losses: in a row, until they are a fault.
        latency_ms: how long an answer may take.
        period_ns: of the cycle.

    Attributes:
        bus: that of the servos.
        time_ns: when the newest good reading was asked for.
        restarted: places of the servos that have started again: what they say is not their
            position, and they are no longer asked.
        lost: group reads so far that failed.
        lost_in_a_row: since the last good one.
        health: the newest readings that hold health, by axis.
        health_ns: when they were asked for.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        *,
        is_fast: bool,
        max_losses: int,
        latency_ms: float,
        period_ns: int,
    ) -> None:
        self.time_ns = 0
        self.restarted: set[int] = set()
        self.lost = self.lost_in_a_row = self.health_ns = 0
        self.health: tuple[Reading, ...] = ()
        self._culprits: dict[int, int] = {}
        self._servos = servos
        self.bus = servos[0].bus
        self._is_fast = is_fast
        self._max_losses = max_losses
        self._latency_ns = round(latency_ms * 1e6)
        self._tail_ms = min(_TAIL_MS, TAIL_SHARE * period_ns * 1e-6)
        self._newest: dict[int, Reading] = {}
        self._clocks = [ServoClock() for _ in servos]
        self._turn = 0
        self._asked: list[int] = []
        self._rows: list[Row] = []
        self._asked_ns = 0

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The newest good readings by axis; empty before there is one of each."""
        if len(self._newest) < len(self._servos):
            return ()
        return tuple(self._newest[place] for place in range(len(self._servos)))

    @property
    def is_waiting(self) -> bool:
        """Whether an answer is on its way."""
        return bool(self._asked)

    def ask(self, now_ns: int) -> None:
        """Ask for the next reading, unless an answer is on its way."""
        present = [place for place in range(len(self._servos)) if place not in self.restarted]
        if self._asked or not present:
            return
        # Each request begins with another servo, so that a dead line is put down to all of them.
        self._turn += 1
        first = self._turn % len(present)
        asked = present[first:] + present[:first]
        if self.lost_in_a_row >= self._max_losses and self._turn // len(present) % 2:
            asked = asked[:1]  # one that is silent hides the answers of the others
        size = (_WHOLE if now_ns - self.health_ns >= HEALTH_NS else _BLOCK).size
        self._rows = [self._servos[place].row(size) for place in asked]
        self.bus.request(self._rows, is_fast=self._is_fast)
        self._asked, self._asked_ns = asked, now_ns

    def take(self, now_ns: int) -> bool:
        """Take the answer in if it is there; return whether there is a new good reading of all.

        Raises:
            FeedbackError: too many were lost in a row.
        """
        if not self._asked:
            return False
        size, available = self._rows[0].size, self.bus.available
        due = answer_bytes(len(self._rows), is_fast=self._is_fast, size=size)
        if available < due and now_ns - self._asked_ns < self._latency_ns:
            return False
        asked, self._asked = self._asked, []
        if available > _FLOOD * due:
            self.bus.clear()
            blocks: list[Block] = []
            missing, why = None, "noise on the line"
        else:
            wait_ms = self._tail_ms if available >= due else 0.0
            blocks, missing = self.bus.collect(self._rows, wait_ms, is_fast=self._is_fast)
            why = "" if len(blocks) == len(asked) else "no whole answer"
        for place, block in zip(asked, blocks, strict=False):
            if problem := self._believe(place, block):
                missing, why = self._servos[place].options.id, problem
        if why:
            self._lose(now_ns, missing, why)
            return False
        if len(asked) + len(self.restarted) < len(self._servos):
            return False
        self.time_ns = self._asked_ns
        self.lost_in_a_row = 0
        self._culprits.clear()
        if size == _WHOLE.size and not self.restarted:
            self.health, self.health_ns = self.readings, self._asked_ns
        return bool(self.readings)

    def _believe(self, place: int, block: Block) -> str:
        """Take one servo's block in, or return why it cannot be believed."""
        servo, clock = self._servos[place], self._clocks[place]
        if number := block.error & ~ALERT:
            return f"error {number} instead of a reading"
        reading = decode(block.content)
        if reading.return_level != RETURN_LEVEL:
            self.restarted.add(place)
            return f"{servo.options.name} has started again"
        late_ms = clock.behind_ms(self._asked_ns, reading.tick)
        if late_ms > STALE_MS:
            return f"{servo.options.name} answered an earlier question, {late_ms:.0f} ms old"
        is_driven = bool(reading.torque)
        if problem := servo.doubt(reading.position, is_driven=is_driven, now_ns=self._asked_ns):
            return f"{servo.options.name} {problem}"
        servo.believe(reading.position, self._asked_ns)
        clock.learn(self._asked_ns, reading.tick)
        self._newest[place] = reading
        return ""

    def settle(self, wait_ms: float) -> None:
        """Get the line free for single questions: await what is on its way, and throw it away."""
        if self._asked:
            self._asked = []
            self.bus.collect(self._rows, wait_ms, is_fast=self._is_fast)
        self.bus.clear()

    def forget(self) -> None:
        """Begin anew: nothing read so far counts."""
        self._newest.clear()
        self.lost_in_a_row = 0
        self._culprits.clear()

    def synchronise(self, clock: Clock) -> None:
        """Learn what every servo's clock says, by asking each a few times alone.

        Raises:
            LinkError: one does not answer.
        """
        for servo, learned in zip(self._servos, self._clocks, strict=True):
            for _ in range(_SOUNDINGS):
                asked_ns = clock.now_ns()
                learned.learn(asked_ns, servo.get(servo.table.tick, PATIENT_ATTEMPTS))

    def _lose(self, now_ns: int, servo: int | None, why: str) -> None:
        self.lost += 1
        self.lost_in_a_row += 1
        if servo is not None:
            self._culprits[servo] = self._culprits.get(servo, 0) + 1
        if self.lost_in_a_row >= self._max_losses:
            age_ms = (now_ns - self.time_ns) * 1e-6 if self.time_ns else float("inf")
            raise FeedbackError(
                f"{self.lost_in_a_row} readings lost in a row, the last good is {age_ms:.0f} ms "
                f"old{self._blame()}: {why}"
            )

    def _blame(self) -> str:
        """Return which servo was missing, or that it was not one alone; nothing if none was."""
        counts = self._culprits
        worst = max(self._servos, key=lambda servo: counts.get(servo.options.id, 0))
        if not counts:
            return ""
        if 2 * counts[worst.options.id] <= sum(counts.values()):
            ids = ", ".join(map(str, sorted(counts)))
            return f"; of servos {ids} alike, so look at the line, its supply and the adapter"
        return f"; most often {worst}"


def listen(
    servos: Sequence[Servo], options: GimbalOptions, period_ns: int, clock: Clock
) -> tuple[Group, list[str]]:
    """Return the group of all servos, read as quickly as they can, and what keeps it from more.

    Args:
        servos: of the gimbal, identified.
        options: of the deployment.
        period_ns: of the cycle.
        clock: of the readings.

    Raises:
        DeviceFaultError: fast reads are asked for that a servo does not know.
        LinkError: the line is too slow for the rate, or a servo does not answer.
    """
    slow = list(filter(None, (servo.why_not_fast() for servo in servos)))
    if slow and options.fast_read == "on":
        raise DeviceFaultError("; ".join(slow))
    is_fast = not slow and options.fast_read != "off"
    group = Group(
        servos, is_fast=is_fast, max_losses=options.max_losses, latency_ms=options.latency_ms,
        period_ns=period_ns,
    )  # fmt: skip
    need_ms = cycle_bytes(len(servos), is_fast=is_fast) * servos[0].bus.byte_ms
    if need_ms > _BUSY_SHARE * period_ns * 1e-6:
        raise LinkError(
            f"a cycle takes {need_ms:.2f} ms on the line at {options.baud} baud, the period "
            f"is {period_ns * 1e-6:.2f} ms; lower the rate or set the servos to a higher "
            "line speed"
        )
    group.synchronise(clock)
    return group, slow if options.fast_read == "auto" else []
