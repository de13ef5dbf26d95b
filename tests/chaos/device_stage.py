"""An emulated device and its daemon, under fault injection."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time

import numpy as np
from command_line import begin, environment
from gimbal_bench import PATIENT, ROOT, STEADY, ExampleDaemon
from harness import assert_limits_kept, is_alive, run_first, until
from stage import ATTEMPTS, LONGEST, STARVED, Calls, longest_wait, waiting

import orientd
from orientd import motion_file
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import word
from orientd.servo.watchdog import SHORTEST_NS
from orientd.stream.records import CycleFlag


def _limits(jerk):
    return {"velocity": 1.5, "acceleration": 8.0, "jerk": jerk}


class DeviceStage:
    """An emulated device, the daemon that drives it, and every setpoint."""

    def __init__(self, folder, tally, name):
        self.tally = tally
        self.calls = Calls(tally, lambda: self.daemon.process.pid)
        self.servos = set()
        if name == "ur":
            address = f"127.{1 + os.getpid() // 250 % 250}.{1 + os.getpid() % 250}.7"
            self.words = ("ur", "--host", address)
            self.device, self.limits, self.rate_hz = "arm", _limits(400.0), 500.0
            example = "ur"
            changes = (
                ("127.0.0.2", address), ("feedback_timeout = 0.1 ", "feedback_timeout = 0.5 "),
            )  # fmt: skip
        else:
            port = folder / "gimbal"
            self.words = ("dynamixel", "--link", str(port))
            self.device, self.limits, self.rate_hz = "gimbal", _limits(1500.0), 100.0
            example = "gimbal"
            # A bus that is silent is a fault sooner than a round waits for it.
            sooner = (f"{STEADY}5.0 ", f"{STEADY}2.0 ")
            changes = (('/tmp/gimbal"', f'{port}"'), *PATIENT, sooner)
        self.motion = motion_file.load(ROOT / "config" / f"{example}-turn.yaml")
        self.daemon = ExampleDaemon(folder, f"{example}.toml", *changes)

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.kill()
            raise
        return self

    def __exit__(self, kind, *_):
        self.robot.close()
        self.daemon.end()
        self.emulator.send_signal(signal.SIGCONT)
        self.emulator.terminate()
        self.emulator.communicate(timeout=20)
        assert kind or not self.left_servos(), "servo processes are left"

    def start(self):
        """Start both, and make a first motion."""
        self.start_emulator()
        self.daemon.start()
        self.robot = orientd.connect(self.daemon.socket)
        self.unless_starved(lambda: self.await_holding(30.0))
        self.unless_starved(self.turn_once)
        self.calls.late.clear()

    def kill(self):
        """End both, whatever state they are in."""
        for process in (getattr(self, "emulator", None), getattr(self.daemon, "process", None)):
            if process is not None and process.poll() is None:
                process.kill()
                process.communicate()
        with contextlib.suppress(AttributeError):
            self.robot.close()
        until(lambda: not self.left_servos(), "the end of all servo processes", 10.0)

    def start_emulator(self):
        """Start the emulator and wait for its line."""
        self.emulator = begin("sim", *self.words, env=environment())
        line = self.emulator.stdout.readline()
        assert line.startswith("ready"), line
        run_first(self.emulator.pid)

    def left_servos(self, *but):
        """Return the servo processes seen so far that still run."""
        return [pid for pid in self.servos if pid not in but and is_alive(pid)]

    def state(self):
        """Return the device's state as the daemon reports it, and measure the call."""
        report = self.calls.measure("GetState", self.robot.state).devices[self.device]
        if report.servo_pid:
            self.servos.add(report.servo_pid)
        return report

    def check_well(self):
        """Check that there is no fault yet."""
        report = self.state()
        assert report.state != pb.STATE_FAULT, f"before any harm: {report.fault_text}"

    def turn(self):
        """Begin the example's motion."""
        return self.robot.move(self.motion)

    @contextlib.contextmanager
    def round(self):
        """Run one round and check all setpoints; restart both processes if it fails."""
        self.calls.late.clear()
        try:
            with self._watched() as cycles:
                yield
            self.check_sent(cycles)
            assert not self.calls.late, "; ".join(self.calls.late)
        except Exception:
            self.kill()
            self.start()
            raise

    @contextlib.contextmanager
    def _watched(self):
        """Collect the setpoints, cycle by cycle."""
        cycles, ending = [], threading.Event()

        def watch():
            with contextlib.suppress(OrientdError):
                for batch in self.robot.watch(self.device, rate_hz=50.0):
                    cycles.extend(batch)
                    if ending.is_set():
                        return

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        until(lambda: cycles, "cycles")
        try:
            yield cycles
        finally:
            time.sleep(0.1)
            ending.set()

    def check_sent(self, cycles):
        """Check that the consecutive setpoints keep the limits."""
        for run in _runs([cycle for cycle in list(cycles) if cycle.flags & CycleFlag.WRITTEN]):
            q = np.array([cycle.q for cycle in run])
            assert_limits_kept(q, 1 / self.rate_hz, self.limits, is_moving=True)

    def recover(self):
        """Recover the device as a user would, and check that it moves again."""
        self.reset()
        self.unless_starved(self.turn_once)
        assert not self.left_servos(self.state().servo_pid)

    def reset(self):
        """Reset the device until it holds, unless it holds already."""
        end = time.monotonic() + 30.0
        while self.state().state != pb.STATE_HOLDING:
            # Servos and robots need some time after their own stops until they can be unlocked.
            try:
                self.robot.reset(self.device)
                break
            except OrientdError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.3)
        self.await_holding(10.0)
        self.robot.set_speed(1.0, self.device)

    def await_holding(self, seconds):
        """Wait until the device holds."""
        until(lambda: self.state().state == pb.STATE_HOLDING, "holding", seconds)

    def turn_once(self):
        """Make the example's motion."""
        summary = self.turn().wait(60.0, check=False)
        assert summary.outcome == pb.OUTCOME_DONE, summary.text

    def unless_starved(self, work):
        """Return the result of *work*, and repeat it if the daemon had no processor."""
        for _ in range(ATTEMPTS - 1):
            pid = self.daemon.process.pid
            before = waiting(pid)
            try:
                return work()
            except (AssertionError, OrientdError):
                fault = word(self.state(), "fault")
                if fault not in STARVED or longest_wait(pid, before) <= LONGEST:
                    raise
                self.tally.met["repeated because the daemon waited for a processor"] += 1
                self.reset()
        return work()


def _runs(cycles):
    """Return the runs of consecutive cycles between delays of the servo process.

    If the device delays a cycle, the next cycle reports the delay in its ``work_ns``.
    """
    runs, longest = [[]], 0.8 * SHORTEST_NS
    for before, cycle, after in zip([None, *cycles], cycles, [*cycles[1:], None], strict=False):
        if before is not None and (
            cycle.index != before.index + 1
            or cycle.deadline_ns - before.deadline_ns > longest
            or (after is not None and after.work_ns > longest)
        ):
            runs.append([])
        runs[-1].append(cycle)
    return [run for run in runs if run]
