"""The real servo, path ring and loopback driver in virtual time, on a path made by hand."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from emulated_dynamixel import ManualClock
from orientd import rotation
from orientd.driver import Setpoint
from orientd.keep_out import KeepOut
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.servo import Servo
from orientd.servo.watchdog import WatchdogTimeouts
from orientd.stream.memory import SharedMemory
from orientd.stream.records import (
    FINAL_WORD,
    JOINTS,
    TAIL_WORD,
    UNKNOWN,
    Answer,
    Command,
    Cycle,
    NoteKind,
    ServoLimits,
    unpack_cycle,
    unpack_note,
)
from orientd_loopback import LoopbackDriver

PERIOD_NS = 2_000_000
PERIOD = PERIOD_NS * 1e-9
TERMS = ServoLimits(2.5, 17.0, 8500.0, 1.0, 10.0, 4.0)


class RecordingLoopback(LoopbackDriver):
    """The loopback driver, which also keeps every setpoint in a list."""

    def open(self):
        super().open()
        self.setpoints: list[Setpoint] = []

    def write(self, setpoint):
        super().write(setpoint)
        self.setpoints.append(setpoint)


@dataclass
class Rig:
    """One servo; ``run`` lets cycles pass."""

    options: dict = field(default_factory=dict)
    capacity: int = 4096
    heartbeat_ns: int = 500_000_000
    feedback_ns: int = 100_000_000
    stall_ns: int = 500_000_000
    offers: dict = field(default_factory=dict)
    """Methods that the driver has besides, by name."""
    kind: type[RecordingLoopback] = RecordingLoopback
    cones: tuple[KeepOut, ...] = ()
    unix_ns: Callable[[], int] = time.time_ns

    def __post_init__(self):
        self.clock = ManualClock(10**9)
        self.memory = SharedMemory.create(self.capacity, 4096)
        self.driver = self.kind(self.options, period_ns=PERIOD_NS, clock=self.clock)
        for name, method in self.offers.items():
            setattr(self.driver, name, method)
        self.driver.open()
        self.parent_is_alive = True
        self.beats = True
        self.servo = Servo(
            self.driver,
            self.memory,
            period_ns=PERIOD_NS,
            watch=WatchdogTimeouts(self.heartbeat_ns, self.feedback_ns, self.stall_ns),
            clock=self.clock,
            parent_is_alive=lambda: self.parent_is_alive,
            cones=KeepOutCones(self.cones, PERIOD, self.unix_ns) if self.cones else None,
        )
        self.memory.beat(self.clock.now_ns())
        self.noted = 0

    def run(self, cycles: int = 1) -> Cycle:
        """Let *cycles* pass and return the last."""
        for _ in range(cycles):
            self.clock.advance(PERIOD_NS)
            if self.beats:
                self.memory.beat(self.clock.now_ns())
            self.servo.cycle(self.clock.now_ns(), 0)
        return self.cycle

    def stall(self, milliseconds: float) -> Cycle:
        """Let the process stand still, then run a cycle; the daemon has not run either."""
        self.clock.advance(round(milliseconds * 1e6) // PERIOD_NS * PERIOD_NS)
        self.servo.cycle(self.clock.now_ns(), 0)
        return self.cycle

    def run_until(self, condition, most: int = 20_000) -> int:
        """Let cycles pass until *condition* holds of the servo; return how many."""
        for count in range(most):
            if condition(self.servo):
                return count
            self.run()
        raise AssertionError(f"not reached within {most} cycles: {self.cycle}")

    @property
    def cycle(self) -> Cycle:
        return unpack_cycle(self.memory.cycles.read_bytes(self.memory.cycles.head - 1))

    def notes(self, kind: NoteKind):
        ring = self.memory.notes
        oldest = max(0, ring.head - ring.capacity)
        found = [unpack_note(ring.read_bytes(i)) for i in range(oldest, ring.head)]
        return [note for note in found if note.kind is kind]

    def ask(
        self,
        command,
        *,
        motion=1,
        path_index=0,
        leave=UNKNOWN,
        final=UNKNOWN,
        start_ns=UNKNOWN,
        speed=1.0,
        servo_limits=TERMS,
    ):
        """Send a command, run a cycle, return the answer."""
        self.memory.commands.publish(
            command,
            motion,
            path_index,
            leave,
            final,
            start_ns,
            speed,
            *servo_limits.floats(),
        )
        self.run()
        answer = self.notes(NoteKind.ANSWER)[-1]
        return Answer(answer.code), answer.text

    def lay(
        self, q, omega, alpha, *, most=None, is_whole=True, position=None, velocity=None,
        joints=None,
    ):  # fmt: skip
        """Put a path into the ring, as a feeder would; return its first index."""
        ring = self.memory.path
        first = ring.head
        ring.words[FINAL_WORD] = 0
        ring.words[TAIL_WORD] = first
        count = len(q) if most is None else most
        position = np.zeros((len(q), 3)) if position is None else position
        velocity = np.zeros((len(q), 3)) if velocity is None else velocity
        joints = np.full((len(q), 2 * JOINTS), np.nan) if joints is None else joints
        for k in range(count):
            index = first + k
            fields = (*q[k], *omega[k], *alpha[k], *position[k], *velocity[k], *joints[k])
            ring.put([ring.layout.pack(index, *fields)], index)
        ring.advance(first + count)
        if is_whole and count == len(q):
            ring.words[FINAL_WORD] = first + count
        return first

    def start(self, path, *, servo_limits=TERMS, **options):
        """Enable, lay *path* and start it."""
        assert self.ask(Command.ENABLE)[0] is Answer.DONE
        first = self.lay(*path, **options)
        assert (
            self.ask(Command.START, path_index=first, servo_limits=servo_limits)[0] is Answer.DONE
        )
        return first

    def sent(self) -> np.ndarray:
        """Return the orientations written, shape (n, 4)."""
        return np.array([setpoint.q for setpoint in self.driver.setpoints])


def turn(angle=1.5, duration=2.0, axis=(0.6, 0.0, 0.8)):
    """Return a rest-to-rest turn as arrays of q, omega, alpha on the record grid."""
    t = np.linspace(0.0, 1.0, round(duration / PERIOD) + 1)
    axis = np.asarray(axis)
    place = t**3 * (10 - 15 * t + 6 * t**2)
    speed = 30 * t**2 * (1 - t) ** 2 / duration
    push = 60 * t * (1 - t) * (1 - 2 * t) / duration**2
    q = rotation.exp(angle * place[:, None] * axis)
    return q, angle * speed[:, None] * axis, angle * push[:, None] * axis


def peaks(q) -> tuple[float, float, float]:
    """Return the largest velocity, acceleration and jerk by backward differences, from rest."""
    q = np.vstack([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])
    omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / PERIOD
    alpha = np.diff(omega, axis=0) / PERIOD
    jerk = np.diff(alpha, axis=0) / PERIOD
    velocity, acceleration, jerk = (
        float(np.linalg.norm(derivative, axis=1).max()) for derivative in (omega, alpha, jerk)
    )
    return velocity, acceleration, jerk


def distance_to_path(q, path) -> float:
    """Return the largest angle from the orientations *q* to a turn about a fixed axis."""
    axis = rotation.log(path[0][-1])
    axis = axis / np.linalg.norm(axis)
    r = rotation.log(np.asarray(q))
    return float(np.linalg.norm(r - np.outer(r @ axis, axis), axis=1).max())
