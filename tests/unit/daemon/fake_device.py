"""Devices without a servo process: commands take effect at once, or when the test says so."""

from __future__ import annotations

import json
import math
import time
from dataclasses import fields, replace

from orientd.daemon.device import DeviceSnapshot, EventKind
from orientd.daemon.device.servo_process import ServoProcess
from orientd.driver import IDENTITY, ZERO
from orientd.errors import DaemonError, Fault
from orientd.model.limits import DEFAULT_LIMITS
from orientd.protocol import control_pb2 as pb
from orientd.stream.memory import SharedMemory
from orientd.stream.records import CYCLE_RECORD, UNKNOWN, Command, Cycle, ServoState

STATISTICS = pb.MotionStatistics(cycles=7, lateness=pb.Durations(), work=pb.Durations())
"""The measurements of every motion."""


def cycle(index=0, *, state=ServoState.HOLDING, lateness_ns=0, motion=0, overruns=0):
    """Return a cycle at rest."""
    return Cycle(
        index, index * 2_000_000, lateness_ns, 0, 0, 0, state, 0, motion, 2, overruns, 0, 0.0, 1.0,
        IDENTITY, ZERO, ZERO, ZERO, IDENTITY, ZERO, ZERO,
    )  # fmt: skip


def record_of(one):
    """Return a cycle as the servo packs it."""
    values = [getattr(one, field.name) for field in fields(one)]
    values = [value for value in values if value is not None]
    flat = [part for value in values for part in (value if isinstance(value, tuple) else (value,))]
    count = len(CYCLE_RECORD.unpack(bytes(CYCLE_RECORD.size)))
    return CYCLE_RECORD.pack(*flat, *(count - len(flat)) * [math.nan])


class FakeDevice:
    """The parts of a device that reports are made of."""

    def __init__(self, settings):
        self.name = settings.name
        self.driver = settings.driver
        self.rate_hz = settings.rate_hz
        self.lead = settings.lead
        self.phase = 0.0
        self.limits = DEFAULT_LIMITS
        self.keep_out = ()
        self.state = ServoState.HOLDING
        self.motion = None
        self.number = 0
        self.published = [cycle()]
        self.is_free = False
        self.last_ended = None
        self.servo_pid = 1

    def snapshot(self):
        return DeviceSnapshot(
            cycle=self.published[-1] if self.published else None,
            state=self.state,
            fault=Fault.NONE,
            fault_text="",
            is_paused=False,
            speed=1.0,
            motion=self.motion,
            motion_number=self.number,
            path_time=0.5,
            tracking_error=None,
            servo_pid=self.servo_pid,
            scheduling="SCHED_OTHER",
            memory_locked=False,
        )

    @property
    def next_cycle(self):
        return self.published[-1].index + 1 if self.published else 0

    def cycle_records(self, since, limit):
        return [record_of(one) for one in self.published if one.index >= since][:limit]


class FakeServo(ServoProcess):
    """A servo that obeys a command at once, or refuses it.

    Attributes:
        asked: the names of the commands.
        now: its newest cycle.
        refusals: raised by the commands to come that begin a motion, the first one first.
        during_start: called while a motion begins.
        is_dead: whether it answers nothing.
    """

    is_alive = True

    def __init__(self, settings, **more):
        super().__init__(settings, **more)
        self.asked, self.refusals, self.is_dead = [], [], False
        self.now = cycle()
        self.final_index = 0
        self.during_start = lambda: None
        self.memory = SharedMemory.create(8192, 256)

    def newest(self):
        return self.now

    def ask(self, command, *, motion=0, final_index=UNKNOWN, **more):
        self.asked.append(command.name.lower())
        if self.is_dead:
            raise DaemonError(f"the servo did not answer {command.name.lower()} within 0.5 s")
        if command in (Command.START, Command.SPLICE, Command.TRACK):
            if self.refusals:
                raise self.refusals.pop(0)
            self.final_index = final_index
            is_tracking = command is Command.TRACK
            self.be(ServoState.TRACKING if is_tracking else ServoState.STREAMING, motion=motion)
            self.during_start()
        elif command in (Command.STOP, Command.HALT) and self.now.state in (
            ServoState.STREAMING,
            ServoState.TRACKING,
        ):
            self.be(ServoState.HOLDING)
        return time.monotonic()

    def running(self):
        return self.memory

    def tuning(self):
        """Return the newest options of the driver."""
        ring = self.memory.tunings
        length, text = ring.read(ring.head - 1)[1:]
        return json.loads(text[:length])

    def brake(self):
        self.ask(Command.STOP)

    def be(self, state, **more):
        """Be in a state from the next cycle on."""
        self.now = replace(self.now, index=self.now.index + 1, state=state, **more)

    def finish(self):
        """Let the motion reach its end."""
        self.be(ServoState.HOLDING, path_index=self.final_index)

    def fall(self, fault, text):
        """Fall into a fault, whatever it does."""
        self.fault, self.fault_text = fault, text
        self.be(ServoState.FAULT, fault=fault)
        self._tell(EventKind.FAULT, text)

    def end(self):
        self.asked.append("end")


def servo_of(device):
    """Return the fake servo of a device."""
    return device._servo


def tend(device):
    """Do what the device's thread does every few cycles."""
    device._tick()
