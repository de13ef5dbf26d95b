"""The cyclic read of all servos: requested in one cycle, received in the next, never waited for.

A missing answer is read in a later cycle.  Meanwhile the driver sends goals and requests nothing.
An answer that is still missing after the adapter's latency is lost, and the last good one ages.
The protocol does not distinguish a late answer from the answer to a later request.  So each block
contains the servo's clock, which shows the time of the measurement.  A block with an impossible
position counts as lost too.

Now and then a request replaces the usual one and adds voltage and temperature: three more bytes per
servo, so no cycle waits for them.
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
"""A block measured this long before its request belongs to an earlier request."""
DRIFT = 0.01
"""Largest relative drift of a servo's clock."""
TAIL_SHARE = 0.2
"""Share of the period that a cycle may wait for the last bytes of an answer."""
HEALTH_NS = 500_000_000
"""Interval between two health readings."""

_TAIL_MS = 1.0
"""Stuffing makes an answer longer than the minimum; its last bytes follow this soon."""
_FLOOD = 2
"""This multiple of the requested bytes is noise."""
_SOUNDINGS = 3
_BUSY_SHARE = 0.8
_BLOCK = struct.Struct("<BBBBHhii")
_WHOLE = struct.Struct("<BBBBHhiiHB")
"""Block with health."""


class Reading(NamedTuple):
    """One block of one servo, in its own units.

    Attributes:
        torque: 1 if it drives.
        return_level: :data:`RETURN_LEVEL`, unless the servo has forgotten the map of the read.
        hardware_error: its bits.
        watchdog: in units of 20 ms; 255 if it has tripped.
        tick: its clock, ms.
        current: in steps.
        velocity: in steps.
        position: ticks, unwrapped by the servo.
        voltage: in steps of 0.1 V; 0 if not requested.
        temperature: degrees Celsius; 0 if not requested.
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
    """Return the length of the answers of *count* servos with *size* bytes of content each."""
    return 8 + count * (size + 4) if is_fast else count * (size + 11)


def cycle_bytes(count: int, *, is_fast: bool) -> int:
    """Return the bytes of a cycle: goals out, request out, answers in."""
    return 14 + 5 * count + 14 + count + answer_bytes(count, is_fast=is_fast)


def decode(content: bytes) -> Reading:
    """Return the values of a block, with health or without."""
    return Reading(*(_WHOLE if len(content) == _WHOLE.size else _BLOCK).unpack(content))


class ServoClock:
    """The offset between a servo's millisecond clock and ours.

    The time between a request and its measurement is never negative.  So the reading farthest
    behind its request gives the offset.  The two clocks may drift apart.
    """

    def __init__(self) -> None:
        self._offset_ms: float | None = None
        self._asked_ns = 0

    def behind_ms(self, asked_ns: int, tick: int) -> float:
        """Return the least time by which *tick* is behind a prompt answer."""
        return self._late_ms(asked_ns, tick) - self._drift_ms(asked_ns)

    def learn(self, asked_ns: int, tick: int) -> None:
        """Update the offset with an accepted reading."""
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
        is_fast: whether they support fast reads.
        max_losses: losses in a row until a fault.
        latency_ms: time for an answer.
        period_ns: of the cycle.

    Attributes:
        bus: that of the servos.
        time_ns: time of the newest good reading's request.
        restarted: places of the servos that have restarted; their reports are not positions, and
            they are no longer read.
        lost: number of failed group reads.
        lost_in_a_row: number since the last good one.
        health: the newest readings with health, by axis.
        health_ns: time of their request.
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
        """The newest good readings by axis; empty until there is one of each."""
        if len(self._newest) < len(self._servos):
            return ()
        return tuple(self._newest[place] for place in range(len(self._servos)))

    @property
    def is_waiting(self) -> bool:
        """Whether an answer is due."""
        return bool(self._asked)

    def ask(self, now_ns: int) -> None:
        """Send the next request, unless an answer is due."""
        present = [place for place in range(len(self._servos)) if place not in self.restarted]
        if self._asked or not present:
            return
        # Each request begins with another servo, so that a dead line is blamed on all of them.
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
        """Read the answer if it has arrived; return whether there is a new good reading of all.

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
        """Accept one servo's block, or return why it is not plausible."""
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
        """Clear the line for single requests: await the answer that is due, and discard it."""
        if self._asked:
            self._asked = []
            self.bus.collect(self._rows, wait_ms, is_fast=self._is_fast)
        self.bus.clear()

    def forget(self) -> None:
        """Start over: earlier readings do not count."""
        self._newest.clear()
        self.lost_in_a_row = 0
        self._culprits.clear()

    def synchronise(self, clock: Clock) -> None:
        """Learn the offset of every servo's clock, by asking each one alone a few times.

        Raises:
            LinkError: a servo does not answer.
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
        """Return which servo was missing, or that it was more than one; empty if none was."""
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
    """Return the group of all servos at its fastest reads, and the reasons if it could be faster.

    Args:
        servos: of the gimbal, identified.
        options: of the deployment.
        period_ns: of the cycle.
        clock: of the readings.

    Raises:
        DeviceFaultError: fast reads are configured, but a servo does not support them.
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
