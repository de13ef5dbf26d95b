"""Whatever is asked for, in whatever order: limits kept, no step, no fault, at rest in the end.

The real servo, path ring, feeder and planner in virtual time.  ``ORIENTD_FUZZ_EVENTS`` says how
many events the slow test makes; a night has time for ten million.
"""

import math
import os
import time
from collections import Counter

import numpy as np
import pytest
from rig import PERIOD, Rig, peaks

from orientd import planner, rotation
from orientd.daemon.devices.servo_link import servo_limits_of
from orientd.daemon.motions.motion_queue import MotionQueue
from orientd.errors import LateError, StateError
from orientd.planner import Keyframe, Limits, MotionRequest, State
from orientd.stream import UNKNOWN, Answer, Command, NoteKind, unpack_note
from orientd.stream import State as ServoState

MANY = int(os.environ.get("ORIENTD_FUZZ_EVENTS", "100000"))
LIMITS = (
    Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    Limits(1.0, 3.0, 60.0, 0.5, 2.0),
    Limits(4.0, 40.0, 2000.0, 1.0, 10.0),
)
KINDS = ("retarget", "retarget", "burst", "queue", "stop", "pause", "override", "halt", "track")
_NO_TERMS = servo_limits_of(LIMITS[0], 1.0)


class VirtualLink:
    """What the daemon has of a servo, with one cycle to every command."""

    def __init__(self, rig):
        self.rig = rig
        self.memory = rig.memory

    def beat(self):
        pass

    def newest(self):
        return self.rig.cycle

    def cycle_records(self, since, limit):
        return []

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
            raise StateError(note.text)


class Fuzz:
    """One device, and somebody who cannot make up his mind."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.limits = LIMITS[seed % len(LIMITS)]
        self.rig = Rig(capacity=16384)
        self.link = VirtualLink(self.rig)
        self.motion_queue = MotionQueue(self.link, lead=0.0, read_ahead=8192)
        self.number = 0
        self.counts = Counter()
        self.link.ask(Command.ENABLE)

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
        motion_queue, cycle = self.motion_queue, self.rig.cycle
        if not motion_queue.is_active:
            return
        try:
            motion_queue.feed()
        except LateError:
            motion_queue.miss()
            self.counts["missed"] += 1
        motion_queue.passed(cycle)
        moving = (ServoState.STREAMING, ServoState.STOPPING)
        if cycle.motion == motion_queue.first.number and cycle.state not in moving:
            ended, *following = motion_queue.clear()
            if following and cycle.path_index == ended.feeder.final_index:
                motion_queue.resume(following, speed=1.0)

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

    def plan(self, start):
        request = MotionRequest([Keyframe(tuple(self.orientation()))], approach=True)
        motion = planner.plan(request, start=start, limits=self.limits, period=PERIOD)
        return motion.recorded()

    def retarget(self):
        self.tend()
        cycle, motion_queue = self.rig.cycle, self.motion_queue
        if cycle.state is ServoState.HOLDING:
            motion_queue.clear()
            motion = self.plan(State.at_rest(cycle.q, cycle.position))
            self.number += 1
            motion_queue.begin(motion, self.number, speed=1.0, start_ns=UNKNOWN)
        elif cycle.state is ServoState.STREAMING and motion_queue.is_active:
            leave = motion_queue.ahead(cycle, int(self.random.integers(2, 9)))
            left = motion_queue.queued(leave.number)
            motion = self.plan(left.motion.state_at(leave.record))
            self.number += 1
            try:
                motion_queue.replace(motion, self.number, leave)
            except LateError as error:
                self.counts["late: " + " ".join(w for w in str(error).split() if w.isalpha())] += 1

    def burst(self):
        for _ in range(4):
            self.retarget()

    def queue(self):
        motion_queue = self.motion_queue
        if self.rig.cycle.state is not ServoState.STREAMING or not motion_queue.is_active:
            return
        last = motion_queue.last
        leave = motion_queue.end(last.motion.last_record)
        motion = self.plan(last.motion.state_at(leave.record))
        self.number += 1
        motion_queue.append(motion, self.number, leave)

    def stop(self):
        self.link.ask(Command.STOP)

    def halt(self):
        self.link.ask(Command.HALT)

    def pause(self):
        self.set_speed(0.0)
        self.let_pass(int(self.random.integers(60)))
        self.set_speed(1.0)

    def set_speed(self, speed):
        if self.rig.cycle.state is ServoState.STREAMING:
            self.link.ask(Command.SPEED, speed=speed)

    def track(self):
        if self.rig.cycle.state not in (ServoState.HOLDING, ServoState.STREAMING):
            return
        self.number += 1
        self.link.ask(
            Command.TRACK, motion=self.number, servo_limits=servo_limits_of(self.limits, 1.0)
        )
        self.motion_queue.clear()
        for _ in range(int(self.random.integers(12))):
            for _ in range(int(self.random.integers(4))):
                self.aim()
            self.let_pass(int(self.random.integers(1, 30)))
        if self.random.integers(2):
            self.link.ask(Command.STOP)

    def aim(self):
        now = self.rig.clock.now_ns() + int(self.random.normal() * 3e7)
        q = self.orientation() if self.random.integers(6) else np.full(4, math.nan)
        omega = self.random.normal(size=3) * self.random.choice([0.0, 1.0, 20.0])
        life = int(self.random.exponential(1e8))
        self.rig.memory.targets.publish(now, now + life, *map(float, q), *map(float, omega))

    def override(self):
        self.set_speed(float(self.random.uniform(0.05, 1.0)))

    def settle(self):
        """Run until nothing moves any more."""
        if self.rig.cycle.state is ServoState.TRACKING:
            self.link.ask(Command.STOP)
        self.set_speed(1.0)
        for _ in range(3000):
            self.let_pass(16)
            if self.rig.cycle.state is ServoState.HOLDING and not self.motion_queue.is_active:
                return
        raise AssertionError(f"does not come to rest: {self.rig.cycle}")


def check(events, seed):
    fuzz = Fuzz(seed)
    fuzz.play(events)
    assert fuzz.rig.cycle.state is ServoState.HOLDING, fuzz.rig.notes(NoteKind.FAULT)
    assert not fuzz.rig.notes(NoteKind.FAULT)
    velocity, acceleration, jerk = peaks(fuzz.rig.sent())
    limits = fuzz.limits
    assert velocity <= 1.001 * limits.velocity
    assert acceleration <= 1.001 * limits.acceleration
    assert jerk <= 1.001 * limits.jerk
    return fuzz.counts


@pytest.mark.parametrize("seed", range(3))
def test_no_order_of_events_breaks_anything(seed):
    check(250, seed)


@pytest.mark.slow
@pytest.mark.timeout(86_400)
def test_no_order_of_a_great_many_events_breaks_anything():
    counts, begun = Counter(), time.monotonic()
    rounds = -(-MANY // 1000)
    for seed in range(rounds):
        counts += check(1000, seed)
        if seed % 10 == 9:
            print(f"{1000 * (seed + 1)} events, {time.monotonic() - begun:.0f} s, {dict(counts)}")
