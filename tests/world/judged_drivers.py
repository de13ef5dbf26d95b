"""A judge before each driver of a world in virtual time."""

from __future__ import annotations

import time
from types import SimpleNamespace

import processes
from judge import Judge, limits_of

from orientd.errors import DeviceError
from orientd.mechanism import Mechanical
from orientd.servo import process as servo_process


class _Judged:
    """A driver whose setpoints are looked at."""

    judge = None

    def enable(self):
        feedback = super().enable()
        self.judge.anchor()
        if isinstance(self, Mechanical):
            mechanism = self.mechanism(may_ask=False)
            self.judge.axes = () if mechanism is None else mechanism.axes
        return feedback

    def read(self):
        try:
            return super().read()
        except DeviceError:
            self.judge.fail(time.monotonic_ns())
            raise

    def write(self, setpoint):
        self.judge.take(time.monotonic_ns(), setpoint.q, setpoint.position, setpoint.joints)
        try:
            super().write(setpoint)
        except DeviceError:
            self.judge.fail(time.monotonic_ns())
            raise

    def disable(self):
        self.judge.let_go(time.monotonic_ns())
        super().disable()


def of_judges(scheduler):
    """Return what puts a judge before each driver: owners, names and values to replace."""
    limits, devices = {}, {}
    begin, run, resolve = processes.Servo._begin, servo_process.run, servo_process.pkgutil

    def begin_judged(servo, settings, descriptor):
        limits[settings.device] = limits_of(servo._settings.limits.to_limits())
        return begin(servo, settings, descriptor)

    def run_judged(descriptor, settings):
        devices[scheduler.current().group] = settings
        return run(descriptor, settings)

    def resolve_judged(name):
        settings, kind = devices[scheduler.current().group], resolve.resolve_name(name)

        def violate(problem):
            scheduler.problems.append(f"{settings.device}: {problem}")

        judge = Judge(limits[settings.device], settings.period_ns * 1e-9, violate)
        return type(kind.__name__, (_Judged, kind), {"judge": judge})

    return [
        (processes.Servo, "_begin", begin_judged),
        (servo_process, "run", run_judged),
        (servo_process, "pkgutil", SimpleNamespace(resolve_name=resolve_judged)),
    ]
