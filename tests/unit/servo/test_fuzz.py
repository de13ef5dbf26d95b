"""Whatever is asked for, in whatever order: limits kept, no step, no fault, at rest in the end.

The real servo, path ring, feeder and planner in virtual time.  ``ORIENTD_FUZZ_EVENTS`` says how
many events the slow test makes; a night has time for a million.  What was sent is judged by
:mod:`setpoint_checker`, which knows nothing of the guard.
"""

import math
import multiprocessing
import os
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from direct_planners import recorded, state_at
from rig import PERIOD, Rig
from setpoint_checker import reached

from orientd import rotation
from orientd.daemon.device.queue import MotionQueue, servo_limits_of
from orientd.daemon.device.queued_motion import QueuedMotion
from orientd.errors import LateError, LimitError, NotYetError, PlanError, StateError
from orientd.model.limits import UNITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner import blending, planning
from orientd.planner.facts import HISTORY
from orientd.planner.recorded import RecordedMotion, rows_of
from orientd.planner.state import State
from orientd.stream.records import (
    NOT_GIVEN,
    UNKNOWN,
    Answer,
    Command,
    NoteKind,
    ServoState,
    unpack_note,
)

MANY = int(os.environ.get("ORIENTD_FUZZ_EVENTS", "100000"))
ROUND = 500
LIMITS = (
    Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    Limits(1.0, 3.0, 60.0, 0.5, 2.0),
    Limits(4.0, 40.0, 2000.0, 1.0, 10.0),
)
KINDS = (
    "retarget", "retarget", "burst", "queue", "blend", "stop", "pause", "override", "halt", "track",
    "stream",
)  # fmt: skip
_NO_TERMS = servo_limits_of(LIMITS[0], 1.0)


class VirtualServo:
    """What the daemon has of a servo, with one cycle to every command."""

    def __init__(self, rig):
        self.rig = rig
        self.memory = rig.memory

    fault_text = ""
    next_cycle = 0

    def running(self):
        return self.memory

    def beat(self):
        pass

    def brake(self):
        self.ask(Command.STOP)

    def newest(self):
        return self.rig.cycle

    def ask(
        self, command, *, motion=0, path_index=0, leave_index=UNKNOWN, final_index=UNKNOWN,
        start_ns=UNKNOWN, speed=0.0, servo_limits=_NO_TERMS,
    ):  # fmt: skip
        index = self.memory.commands.head
        self.memory.commands.publish(
            command,
            motion,
            path_index,
            leave_index,
            final_index,
            start_ns,
            speed,
            *servo_limits.floats(),
        )
        self.rig.run()
        ring = self.memory.notes
        for k in range(ring.head - 1, -1, -1):
            note = unpack_note(ring.read_bytes(k))
            if note.kind is NoteKind.ANSWER and note.command == index:
                break
        if note.code != Answer.DONE:
            error = NotYetError if note.code == Answer.NOT_YET else StateError
            raise error(note.text)


class Fuzz:
    """One device, and somebody who cannot make up his mind."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.limits = LIMITS[seed % len(LIMITS)]
        self.rig = Rig(capacity=16384)
        self.servo = VirtualServo(self.rig)
        self.motion_queue = MotionQueue(self.servo, self.hear, lead=0.0, read_ahead=8192)
        self.number = 0
        self.counts = Counter()
        self.servo.ask(Command.ENABLE)

    def play(self, events):
        """Let *events* happen, then come to rest."""
        for _ in range(events):
            kind = KINDS[self.random.integers(len(KINDS))]
            getattr(self, kind)()
            self.counts[kind] += 1
            self.let_pass(int(self.random.exponential(12.0)))
        self.settle()

    def let_pass(self, cycles):
        for k in range(cycles):
            self.rig.run()
            if k % 8 == 0:
                self.tend()

    def tend(self):
        """Do what the device's thread does."""
        self.motion_queue.tend()

    def hear(self, kind, queued, text):
        """Count how motions end."""
        self.counts[kind.value] += 1

    def orientation(self):
        kind = self.random.integers(8)
        here = np.array(self.rig.cycle.q)
        vector = self.random.normal(size=3)
        vector /= np.linalg.norm(vector)
        if kind == 0:
            return here
        if kind == 1:
            return -here
        if kind == 2:
            return rotation.multiply(here, rotation.exp(math.pi * vector))
        if kind == 3:
            return rotation.multiply(here, rotation.exp(1e-7 * vector))
        if kind == 4:
            return rotation.multiply(here, rotation.exp(-0.7 * np.array(self.rig.cycle.omega_body)))
        return rotation.exp(self.random.normal(size=3) * 1.2)

    def request(self):
        position = None if self.random.integers(2) else tuple(self.random.normal(size=3) * 0.2)
        keyframe = Keyframe(tuple(self.orientation()), position=position)
        return MotionRequest([keyframe], approach=True)

    def plan(self, start):
        # Now and then for lower limits, which refuses what moves beyond them.
        share = self.random.choice([1.0, 1.0, 0.7, 0.4])
        lower = self.limits.with_rates({name: share * getattr(self.limits, name) for name in UNITS})
        try:
            return self.planned(start, lower)
        except (LimitError, PlanError):
            return self.planned(start, self.limits)

    def planned(self, start, limits):
        request = self.request()
        return recorded(planning.plan(request, start=start, limits=limits, period=PERIOD))

    def retarget(self):
        self.tend()
        cycle, motion_queue = self.rig.cycle, self.motion_queue
        if cycle.state is ServoState.HOLDING:
            motion_queue.clear()
            motion = self.plan(State.at_rest(cycle.q, cycle.position))
            self.number += 1
            motion_queue.begin(QueuedMotion(motion, number=self.number))
        elif cycle.state is ServoState.STREAMING and motion_queue.is_active:
            leave = motion_queue.ahead(cycle, int(self.random.integers(2, 9)))
            left = motion_queue.queued(leave.number)
            try:
                motion = self.plan(state_at(left.motion, leave.record))
            except LimitError as error:
                # It gains speed just below its limit: what nothing can take over from is stopped.
                if not error.is_in_lead_in:
                    raise
                self.counts["stopped"] += 1
                self.stop()
                return
            self.number += 1
            try:
                motion_queue.replace(QueuedMotion(motion, number=self.number), leave)
            except LateError as error:
                self.count_late(error)

    def burst(self):
        for _ in range(4):
            self.retarget()

    def queue(self):
        motion_queue = self.motion_queue
        if self.rig.cycle.state is not ServoState.STREAMING or not motion_queue.is_active:
            return
        last = motion_queue.last
        leave = motion_queue.end(last.motion.last_record)
        motion = self.plan(state_at(last.motion, leave.record))
        self.number += 1
        motion_queue.append(QueuedMotion(motion, number=self.number, begins=leave), leave)

    def blend(self):
        """Follow the last motion by another one that cuts the corner."""
        motion_queue, cycle = self.motion_queue, self.rig.cycle
        if cycle.state is not ServoState.STREAMING or not motion_queue.is_active:
            return
        last, earliest = motion_queue.last, 0
        if last is motion_queue.first:
            earliest = motion_queue.ahead(cycle, 8).record
        facts = last.motion.facts
        count = HISTORY + facts.record_count
        try:
            record, motion = blending.blend(
                RecordedMotion(facts, rows_of(last.motion.read(-HISTORY, count))),
                self.request(),
                tolerance=float(self.random.choice([0.0, 0.02, 0.1])),
                limits=self.limits,
                period=PERIOD,
                earliest=earliest,
            )
        except PlanError:
            return
        self.number += 1
        try:
            leave = motion_queue.end(record)
            queued = QueuedMotion(recorded(motion), number=self.number, begins=leave)
            motion_queue.append(queued, leave)
        except LateError as error:
            self.count_late(error)

    def count_late(self, error):
        self.counts["late: " + " ".join(w for w in str(error).split() if w.isalpha())] += 1

    def stop(self):
        self.servo.ask(Command.STOP)

    def halt(self):
        self.servo.ask(Command.HALT)

    def pause(self):
        self.set_speed(0.0)
        self.let_pass(int(self.random.integers(60)))
        self.set_speed(1.0)

    def set_speed(self, speed):
        if self.rig.cycle.state is ServoState.STREAMING:
            self.servo.ask(Command.SPEED, speed=speed)

    def begin_tracking(self):
        """Take over whatever moves; return whether that was possible."""
        if self.rig.cycle.state not in (ServoState.HOLDING, ServoState.STREAMING):
            return False
        self.number += 1
        self.servo.ask(
            Command.TRACK, motion=self.number, servo_limits=servo_limits_of(self.limits, 1.0)
        )
        self.motion_queue.clear()
        return True

    def track(self):
        """Follow targets that nothing could follow."""
        if not self.begin_tracking():
            return
        for _ in range(int(self.random.integers(12))):
            for _ in range(int(self.random.integers(4))):
                self.aim()
            self.let_pass(int(self.random.integers(1, 30)))
        if self.random.integers(2):
            self.servo.ask(Command.STOP)

    def aim(self):
        now = self.rig.clock.now_ns() + int(self.random.normal() * 3e7)
        q = self.orientation() if self.random.integers(6) else np.full(4, math.nan)
        omega, position = NOT_GIVEN, NOT_GIVEN
        if self.random.integers(2):
            omega = self.random.normal(size=3) * self.random.choice([0.0, 1.0, 20.0])
        if self.random.integers(2):
            position = self.random.normal(size=3) * self.random.choice([0.01, 1.0, 1e4])
        self.publish(now, q, omega, position, int(self.random.exponential(1e8)))

    def stream(self):
        """Follow a smooth target, some of whose packets are lost, late and out of order."""
        if not self.begin_tracking():
            return
        every = int(self.random.choice([2, 8, 17]))
        ahead, has_velocity, has_position = (
            self.random.choice([0.0, 0.06]),
            *self.random.integers(2, size=2),
        )
        here, origin = np.array(self.rig.cycle.q), np.array(self.rig.cycle.position)
        swing, rate = self.random.normal(size=3) * 0.3, self.random.uniform(0.5, 8.0)
        late = []
        for k in range(int(self.random.integers(10, 300))):
            now = self.rig.clock.now_ns()
            if k % every == 0 and self.random.random() > 0.2:
                t = k * PERIOD
                late.append((now + int(self.random.uniform(0.0, 5e7)), now + int(ahead * 1e9), t))
            for due, stamp, t in [packet for packet in late if packet[0] <= now]:
                late.remove((due, stamp, t))
                q = rotation.multiply(here, rotation.exp(math.sin(rate * t) * swing))
                omega = rate * math.cos(rate * t) * swing if has_velocity else NOT_GIVEN
                position = origin + 0.3 * math.sin(rate * t) * swing if has_position else NOT_GIVEN
                self.publish(stamp, q, omega, position, int(2e8))
            self.rig.run()
        if self.random.integers(2):
            self.servo.ask(Command.STOP)

    def publish(self, now, q, omega, position, life):
        self.counts["target"] += 1
        numbers = map(float, (*q, *omega, *position))
        self.rig.memory.targets.publish(now, now + life, *numbers)

    def override(self):
        self.set_speed(float(self.random.uniform(0.05, 1.0)))

    def settle(self):
        """Run until nothing moves any more."""
        if self.rig.cycle.state is ServoState.TRACKING:
            self.servo.ask(Command.STOP)
        self.set_speed(1.0)
        for _ in range(3000):
            self.let_pass(16)
            if self.rig.cycle.state is ServoState.HOLDING and not self.motion_queue.is_active:
                return
        raise AssertionError(f"does not come to rest: {self.rig.cycle}")


def check(events, seed):
    fuzz = Fuzz(seed)
    fuzz.play(events)
    assert_kept(fuzz)
    return fuzz.counts


def assert_kept(fuzz):
    """Check that nothing moves, nothing was a fault, and no limit was broken."""
    assert fuzz.rig.cycle.state is ServoState.HOLDING, fuzz.rig.notes(NoteKind.FAULT)
    assert not fuzz.rig.notes(NoteKind.FAULT)
    setpoints = fuzz.rig.driver.setpoints
    found = reached([s.q for s in setpoints], [s.position for s in setpoints], PERIOD)
    for name, size in found.items():
        assert size <= 1.001 * getattr(fuzz.limits, name), name


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]
)
def test_no_order_of_events_breaks_anything(seed):
    check(250, seed)


def test_motions_that_begin_again_after_a_rest_may_come_too_late_for_each_other():
    # One is replaced shortly before it ends, in the cycles in which the servo comes to rest.
    check(500, 34)


@pytest.mark.slow
@pytest.mark.timeout(86_400)
def test_no_order_of_a_great_many_events_breaks_anything():
    counts, begun = Counter(), time.monotonic()
    rounds = -(-MANY // ROUND)
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("fork")) as pool:
        for done, found in enumerate(pool.map(check, [ROUND] * rounds, range(rounds)), 1):
            counts += found
            if done % 10 == 0:
                print(f"{ROUND * done} events, {time.monotonic() - begun:.0f} s, {dict(counts)}")


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]
)
def test_a_motion_may_begin_in_the_cycle_after_the_end_of_another(seed):
    fuzz = Fuzz(seed)
    for _ in range(60):
        fuzz.retarget()
        while fuzz.rig.cycle.state in (ServoState.STREAMING, ServoState.STOPPING):
            fuzz.let_pass(1)
    assert fuzz.number == 60
    assert_kept(fuzz)
