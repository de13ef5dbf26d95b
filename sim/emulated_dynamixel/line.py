"""The half-duplex line between host and servos: speed, turnaround, the adapter's delay, faults."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class SerialLine:
    """Timing of bytes.

    Attributes:
        is_paced: whether bytes take the time of the line speed.  Otherwise they take none, and
            neither turnaround nor return delay counts.
        turnaround_ns: time from the end of an instruction to the start of an answer, in addition to
            the servo's own return delay.
        usb_latency_ns: largest delay of an answer by the adapter; uniform from 0.
        has_collisions: whether an instruction that begins during an answer spoils both.  Not for a
            pseudo-terminal: a late wake-up of the emulator would cause collisions that no wire has.
    """

    is_paced: bool = False
    turnaround_ns: int = 50_000
    usb_latency_ns: int = 0
    has_collisions: bool = True

    def duration_ns(self, count: int, baud: int) -> int:
        """Return the duration of *count* bytes of ten bits at *baud*."""
        return count * 10_000_000_000 // baud if self.is_paced else 0


class FaultKind(StrEnum):
    """Kinds of faults of an answer."""

    DROP = "drop"
    CORRUPT = "corrupt"
    DELAY = "delay"
    TRUNCATE = "truncate"


@dataclass(slots=True)
class ReplyFault:
    """A fault of one servo's answers.

    Attributes:
        kind: its kind.
        probability: of each answer being affected.
        remaining: number of answers that may still be affected; ``None`` is unlimited.
        delay_ns: delay of a late answer.
    """

    kind: FaultKind
    probability: float = 1.0
    remaining: int | None = None
    delay_ns: int = 20_000_000


@dataclass(slots=True)
class Faults:
    """All faults of the answers on a bus.

    Attributes:
        rng: random generator.
    """

    rng: random.Random
    _of: dict[int, list[ReplyFault]] = field(default_factory=dict)

    def add(self, servo: int, fault: ReplyFault) -> None:
        """Apply *fault* to the answers of *servo*."""
        self._of.setdefault(servo, []).append(fault)

    def clear(self, servo: int | None = None) -> None:
        """Remove the faults of *servo*, or all."""
        if servo is None:
            self._of.clear()
        else:
            self._of.pop(servo, None)

    def apply(self, servo: int, reply: bytes) -> tuple[bytes, int]:
        """Return *reply* after the faults, empty if it is lost, and its delay in ns."""
        delay_ns = 0
        for fault in self._of.get(servo, ()):
            if fault.remaining == 0 or self.rng.random() >= fault.probability:
                continue
            if fault.remaining is not None:
                fault.remaining -= 1
            if fault.kind is FaultKind.DROP:
                return b"", 0
            if fault.kind is FaultKind.CORRUPT:
                at = self.rng.randrange(len(reply))
                flipped = reply[at] ^ (1 << self.rng.randrange(8))
                reply = reply[:at] + bytes([flipped]) + reply[at + 1 :]
            elif fault.kind is FaultKind.TRUNCATE:
                reply = reply[: self.rng.randrange(1, len(reply))]
            else:
                delay_ns += fault.delay_ns
        return reply, delay_ns


@dataclass(slots=True)
class _Reply:
    start_ns: int
    end_ns: int
    arrival_ns: int
    octets: bytes


class Wire:
    """Answers in transit to the host, in one queue: a late one delays those behind it.

    Attributes:
        line: timing of bytes.
        faults: faults of answers.
        collisions: number of instructions that began during an answer.
    """

    def __init__(self, line: SerialLine, rng: random.Random) -> None:
        self.line = line
        self.faults = Faults(rng)
        self.collisions = 0
        self._rng = rng
        self._replies: deque[_Reply] = deque()
        self._free_ns, self._baud = 0, 1_000_000

    def due_ns(self) -> int | None:
        """Return when the next answer reaches the host, ``None`` if there is none."""
        return self._replies[0].arrival_ns if self._replies else None

    def take(self, now_ns: int) -> bytes:
        """Return the answers that have reached the host by *now_ns*."""
        octets = b""
        while self._replies and self._replies[0].arrival_ns <= now_ns:
            octets += self._replies.popleft().octets
        return octets

    def discard(self) -> None:
        """Discard the answers in transit, as when the adapter is unplugged."""
        self._replies.clear()

    def collides(self, start_ns: int) -> bool:
        """Spoil the answers that collide with an instruction beginning at *start_ns*."""
        hit = False
        for reply in self._replies if self.line.has_collisions else ():
            if reply.start_ns <= start_ns < reply.end_ns:
                reply.octets = bytes([reply.octets[0] ^ 0xFF]) + reply.octets[1:]
                hit = True
        self.collisions += hit
        return hit

    def begin_turn(self, now_ns: int, baud: int) -> None:
        """Let the servos answer, one after the other, an instruction received at *now_ns*."""
        self._free_ns, self._baud = now_ns, baud

    def answer(self, servo: int, octets: bytes, return_delay_ns: int) -> bytes:
        """Let *servo* answer with *octets*; return those on the line, after its faults."""
        line = self.line
        octets, delay_ns = self.faults.apply(servo, octets)
        if not octets:
            return octets
        start_ns = self._free_ns + (line.turnaround_ns + return_delay_ns if line.is_paced else 0)
        self._free_ns = start_ns + line.duration_ns(len(octets), self._baud)
        usb_ns = line.usb_latency_ns
        arrival_ns = self._free_ns + delay_ns + (self._rng.randrange(usb_ns) if usb_ns else 0)
        if self._replies:
            arrival_ns = max(arrival_ns, self._replies[-1].arrival_ns)
        self._replies.append(_Reply(start_ns, self._free_ns, arrival_ns, octets))
        return octets
