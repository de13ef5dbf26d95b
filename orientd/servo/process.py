"""The servo process: set up, run one cycle at every deadline, leave the device holding, end.

The daemon starts it as ``python -m orientd.servo DESCRIPTOR`` with its :class:`.ProcessSettings` as
JSON on standard input.  It runs in its own session, so that a Ctrl-C for the daemon does not reach
it.
"""

from __future__ import annotations

import contextlib
import json
import os
import pkgutil
import signal
import sys
import time
from pathlib import Path

from orientd.clock import MonotonicClock
from orientd.driver import Driver, Healthy, PhaseLocked, needs
from orientd.errors import Fault, OrientdError
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.realtime import DeadlineTimer, freeze_garbage, lock_memory, set_scheduling
from orientd.servo.servo import Servo, fault_of
from orientd.servo.settings import ProcessSettings
from orientd.servo.stop_socket import StopSocket
from orientd.servo.watchdog import SHORTEST_NS, WatchdogTimeouts
from orientd.stream.memory import SharedMemory
from orientd.stream.records import NoteKind, pack_note

LARGEST_SHIFT = 400
"""Share of a period by which a deadline may shift to suit a device's own cycle."""


def run(descriptor: int, settings: ProcessSettings) -> int:
    """Run the servo process of one device, from opening to closing it.

    Returns:
        The exit status: 0 after an orderly end, 1 if the device could not be opened.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A terminal may stop processes that write from the background (`stty tostop`).
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    memory = SharedMemory(descriptor, settings.path_capacity, settings.cycle_capacity)
    clock = MonotonicClock()
    driver: Driver | None = None
    try:
        stop_socket = None
        if settings.stop_path:
            stop_socket = StopSocket(settings.stop_path, settings.daemon_pid, settings.admitted)
        kind: type[Driver] = pkgutil.resolve_name(settings.driver)
        driver = kind(settings.options, period_ns=settings.period_ns, clock=clock)
        driver.open()
    except Exception as error:  # noqa: BLE001 - the daemon must learn of any error
        if isinstance(error, ModuleNotFoundError):
            text = needs(error)
        elif isinstance(error, OrientdError):
            text = str(error)
        else:
            text = f"{type(error).__name__}: {error}"
        fault = fault_of(error)
        fault = Fault.SERVO_DIED if fault is Fault.INTERNAL else fault
        if isinstance(driver, Healthy):
            # The user learns of changes that it made before the error.
            with contextlib.suppress(Exception):
                for notice in driver.notices():
                    memory.notes.publish(*pack_note(0, NoteKind.NOTICE, 0, notice))
        memory.notes.publish(*pack_note(0, NoteKind.ENDING, fault, text))
        return 1
    servo = Servo(
        driver,
        memory,
        period_ns=settings.period_ns,
        watch=WatchdogTimeouts(
            settings.heartbeat_timeout_ns, settings.feedback_timeout_ns, settings.stall_timeout_ns
        ),
        clock=clock,
        parent_is_alive=lambda: os.getppid() == settings.daemon_pid,
        stop_socket=stop_socket,
        cones=KeepOutCones(settings.keep_out, settings.period_ns * 1e-9)
        if settings.keep_out
        else None,
    )
    signal.signal(signal.SIGTERM, lambda *_: servo.request_orderly_end("SIGTERM"))
    is_locked = lock_memory()
    scheduling = set_scheduling(settings.priority)
    freeze_garbage()
    ready = json.dumps({"scheduling": scheduling, "memory_locked": is_locked})
    memory.notes.publish(*pack_note(0, NoteKind.READY, 0, ready))
    try:
        servo.reports.publish_notices()
    except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
        servo.take_fault(error)
    try:
        timer = DeadlineTimer(settings.spin_ns)
        run_cycles(
            servo,
            timer,
            settings.period_ns,
            driver if isinstance(driver, PhaseLocked) else None,
            phase_ns=settings.phase_ns,
        )
    finally:
        servo.close()
        _write_report(Path(settings.report_path), servo.report())
        memory.notes.publish(*pack_note(0, NoteKind.ENDING, 0, servo.ending))
        memory.close()
    return 0


def run_cycles(
    servo: Servo,
    timer: DeadlineTimer,
    period_ns: int,
    device: PhaseLocked | None = None,
    *,
    phase_ns: int = 0,
) -> None:
    """Call ``servo.cycle`` at every deadline until the servo has ended.

    Deadlines are a period apart, *phase_ns* after its multiples on the clock.  A *device* with a
    cycle of its own may shift each one by up to a period over :data:`LARGEST_SHIFT`.  A deadline
    that has passed completely is counted and skipped, even before a cycle if the process was
    stalled.  Path time skips nothing, so a late cycle never makes the device jump.
    """
    overrun_ns, most_ns = period_ns // 2, period_ns // LARGEST_SHIFT
    deadline = (time.monotonic_ns() // period_ns + 2) * period_ns + phase_ns
    while not servo.has_ended:
        woken = timer.wait(deadline)
        lateness = woken - deadline
        if lateness > SHORTEST_NS:
            skipped = lateness // period_ns
            servo.count_late(missed=skipped)
            deadline += skipped * period_ns
            lateness = woken - deadline
        if lateness > overrun_ns:
            servo.count_late(overruns=1)
        servo.cycle(deadline, lateness)
        done = time.monotonic_ns()
        servo.work_ns = done - woken
        shift_ns = 0
        if device is not None:
            try:
                shift_ns = int(device.deadline_shift_ns(deadline))
            except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
                servo.take_fault(error)
        deadline += period_ns + max(-most_ns, min(most_ns, shift_ns))
        if done > deadline:
            skipped = (done - deadline) // period_ns + 1
            servo.count_late(missed=skipped)
            deadline += skipped * period_ns


def _write_report(path: Path, report: dict[str, object]) -> None:
    """Write down why the process ended, in case the daemon is gone."""
    try:
        path.write_text(json.dumps({"time": time.time(), **report}) + "\n")
    except OSError as error:
        print(f"cannot write {path}: {error}", file=sys.stderr)  # noqa: T201 - the last words
