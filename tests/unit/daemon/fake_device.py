"""A device without a servo process: what it is told happens at once, or when the test says so."""

from __future__ import annotations

import math
import os
import time
from dataclasses import fields

from orientd.daemon.devices.device_report import DeviceEvent, DeviceSnapshot, EventKind
from orientd.daemon.motions.options import AT_ONCE, Prepared
from orientd.daemon.planners import PlanInput
from orientd.driver import IDENTITY, ZERO
from orientd.errors import DaemonError, Fault, LateError, NotYetError, PlanError, StateError
from orientd.planner import DEFAULT_LIMITS, State
from orientd.rpc import control_pb2 as pb
from orientd.stream import CYCLE_RECORD, Cycle, ServoState

STATISTICS = pb.MotionStatistics(cycles=7, lateness=pb.Durations(), work=pb.Durations())
"""What is measured of every motion."""


def cycle(index=0, *, state=ServoState.HOLDING, lateness_ns=0, motion=0, overruns=0):
    """Return a cycle at rest."""
    return Cycle(
        index, index * 2_000_000, lateness_ns, 0, 0, 0, state, 0, motion, 2, overruns, 0, 0.0, 1.0,
        IDENTITY, ZERO, ZERO, ZERO, IDENTITY, ZERO, ZERO,
    )  # fmt: skip


def record_of(one):
    """Return a cycle as the servo packs it."""
    values = [getattr(one, field.name) for field in fields(one)]
    flat = [part for value in values for part in (value if isinstance(value, tuple) else (value,))]
    count = len(CYCLE_RECORD.unpack(bytes(CYCLE_RECORD.size)))
    return CYCLE_RECORD.pack(*flat, *(count - len(flat)) * [math.nan])


class FakeDevice:
    """The parts of a device that a cell needs."""

    def __init__(self, settings, *, planners, on_event, stops=None):
        self.planners = planners
        self.name = settings.name
        self.driver = settings.driver
        self.rate_hz = settings.rate_hz
        self.period_ns = settings.period_ns
        self.lead = settings.lead
        self.phase = 0.0
        self.limits = DEFAULT_LIMITS
        self.failure = ""
        self.calls = []
        self.events = on_event
        self.state = ServoState.HOLDING
        self.fault = Fault.NONE
        self.fault_text = ""
        self.motion = None
        self.number = 0
        self.at = State.at_rest(IDENTITY)
        self.published = [cycle()]
        self.is_dead = self.is_free = False
        self.refusal = ""
        self.lateness = self.unsteady = 0
        self.began = {}
        self.during_start = lambda: None
        self.stops_beside = 0

    def launch(self):
        self.calls.append("launch")

    def wait_ready(self, timeout):
        return not self.failure

    def shutdown(self):
        self.calls.append("shutdown")

    def commanded(self):
        if self.state is not ServoState.HOLDING:
            raise StateError(f"device {self.name} is {self.state.name.lower()}, not holding")
        return self.at

    async def plan(self, order):
        if self.refusal:
            raise PlanError(self.refusal)
        job = PlanInput(self.name, order.motion, os.urandom(6).hex(), self.commanded())
        return await self.planners.plan(job, order)

    def is_at(self, joints):
        return True

    async def prepare(self, order, move_options=AT_ONCE, *, attempt=0):
        if self.lateness > attempt:
            raise LateError("the path has passed record 3, it is at 4")
        return Prepared(await self.plan(order), move_options=move_options)

    async def await_steady(self):
        self.calls.append("await_steady")

    def start(self, prepared):
        self.commanded()
        if self.unsteady:
            self.unsteady -= 1
            raise NotYetError("the speed is changing")
        self.number += 1
        self.motion, self.state = prepared.motion, ServoState.STREAMING
        self.calls.append(f"start {self.number}")
        self.tell(EventKind.MOTION_STARTED, "")
        self.during_start()
        return self.number

    def halt(self):
        self.calls.append("halt")

    def withdraw(self, number, reason):
        return False

    def settled_after(self, number):
        return None

    def began_ns(self, number):
        return self.began.get(number)

    def stop(self):
        self.calls.append("stop")
        if self.is_dead:
            raise DaemonError("the servo did not answer stop within 0.5 s")
        if self.state is ServoState.STREAMING:
            self.state = ServoState.HOLDING
            self.tell(EventKind.MOTION_STOPPED, "stopped on its path")

    def finish(self):
        """Let the motion reach its end."""
        self.state = ServoState.HOLDING
        self.tell(EventKind.MOTION_DONE, "")

    def fail(self, fault, text):
        """Let the device fall into a fault, whatever it does."""
        self.state, self.fault, self.fault_text = ServoState.FAULT, fault, text
        self.tell(EventKind.FAULT, text)
        self.tell(EventKind.MOTION_STOPPED, text)

    def end_free(self):
        self.calls.append("end_free")

    def enable(self):
        self.calls.append("enable")

    def disable(self):
        self.calls.append("disable")

    def set_speed(self, speed):
        self.calls.append(f"speed {speed:g}")

    def reset(self):
        self.calls.append("reset")

    def snapshot(self):
        return DeviceSnapshot(
            cycle=self.published[-1] if self.published else None,
            state=self.state,
            fault=self.fault,
            fault_text=self.fault_text,
            is_paused=False,
            speed=1.0,
            motion=self.motion,
            motion_number=self.number,
            path_time=0.5,
            tracking_error=None,
            servo_pid=1,
            scheduling="SCHED_OTHER",
            memory_locked=False,
        )

    @property
    def next_cycle(self):
        return self.published[-1].index + 1 if self.published else 0

    def cycle_records(self, since, limit):
        return [record_of(one) for one in self.published if one.index >= since][:limit]

    def statistics(self, number):
        return STATISTICS if number == self.number else None

    def tell(self, kind, text):
        self.events(DeviceEvent(self.name, kind, self.number, text, time.monotonic_ns()))
