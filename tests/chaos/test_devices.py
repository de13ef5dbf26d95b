"""Emulated devices killed, stopped and resumed at random moments of motions; `make chaos`."""

import contextlib
import itertools
import os
import signal
import threading
import time

import numpy as np
import pytest
from command_line import begin, environment
from gimbal_bench import PATIENT, ROOT, GimbalDaemon
from harness import is_alive, peaks, until
from ledger import Tally, rounds_of
from stage import Calls

import orientd
from orientd import motion_file
from orientd.errors import Fault, OrientdError
from orientd.rpc.reports import Outcome
from orientd.stream import CycleFlag, State

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]


class Rig:
    """An emulated device, a daemon that drives it, and every setpoint that it is sent."""

    def __init__(self, folder, tally, name):
        self.name, self.folder, self.tally = name, folder, tally
        self.calls = Calls(tally, lambda: self.daemon.process.pid)
        self.servos = []
        if name == "ur":
            address = f"127.{1 + os.getpid() // 250 % 250}.{1 + os.getpid() % 250}.7"
            self.words = ("ur", "--host", address)
            self.device, self.limits, self.rate_hz = "arm", (1.5, 8.0, 400.0), 500.0
            self.motion = motion_file.load(ROOT / "config" / "ur-turn.yaml")
            text = (ROOT / "config" / "ur.toml").read_text().replace("127.0.0.2", address)
            text = text.replace("feedback_timeout = 0.1 ", "feedback_timeout = 0.5 ")
        else:
            port = folder / "gimbal"
            self.words = ("dynamixel", "--link", str(port))
            self.device, self.limits, self.rate_hz = "gimbal", (1.5, 8.0, 1500.0), 100.0
            self.motion = motion_file.load(ROOT / "config" / "gimbal-turn.yaml")
            text = (ROOT / "config" / "gimbal.toml").read_text()
            for old, new in (('/tmp/gimbal"', f'{port}"'), *PATIENT):
                text = text.replace(old, new)
        self.daemon = GimbalDaemon.__new__(GimbalDaemon)
        self.daemon.folder = folder
        self.daemon.socket = folder / "control.sock"
        self.daemon.config = folder / "device.toml"
        self.daemon.config.write_text(f'[daemon]\nsocket = "{self.daemon.socket}"\n{text}')

    def __enter__(self):
        self.start_device()
        try:
            self.daemon.start()
            self.robot = orientd.connect(self.daemon.socket)
            until(lambda: self.state().state is State.HOLDING, "holding", 30.0)
            self.turn().wait(60.0)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        with contextlib.suppress(AttributeError):
            self.robot.close()
        with contextlib.suppress(AttributeError):
            self.daemon.end()
        self.process.send_signal(signal.SIGCONT)
        self.process.terminate()
        self.process.communicate(timeout=20)
        assert not [pid for pid in self.servos if is_alive(pid)]

    def start_device(self):
        """Start the emulator and wait for its line."""
        self.process = begin("sim", *self.words, env=environment())
        line = self.process.stdout.readline()
        assert line.startswith("ready"), line

    def state(self):
        """Return the device as the daemon tells of it, measured."""
        report = self.calls.measure("GetState", self.robot.state)
        return report.devices[self.device]

    def turn(self):
        """Begin the example's motion."""
        return self.robot.move(self.motion)

    @contextlib.contextmanager
    def watched(self):
        """Collect what is sent, cycle by cycle."""
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
        """See that every written setpoint keeps the limits with those before it."""
        written = [cycle for cycle in list(cycles) if cycle.flags & CycleFlag.WRITTEN]
        runs = itertools.groupby(enumerate(written), lambda pair: pair[1].index - pair[0])
        for _, run in runs:
            q = np.array([cycle.q for _, cycle in run])
            for found, limit in zip(_inner_peaks(q, 1.0 / self.rate_hz), self.limits, strict=True):
                assert found <= 1.001 * limit, (found, limit)


def _inner_peaks(q, period):
    """Return the peaks of setpoints that need not begin at rest."""
    if len(q) < 5:
        return (0.0, 0.0, 0.0)
    same = np.array_equal(q[0], q[1]) and np.array_equal(q[1], q[2])
    return peaks(q, period) if same else (0.0, 0.0, 0.0)


def kill(rig, generator):
    rig.process.kill()
    rig.process.communicate()
    return lambda: rig.start_device()


def stop(rig, generator):
    rig.process.send_signal(signal.SIGSTOP)
    return lambda: rig.process.send_signal(signal.SIGCONT)


FAULTS = {Fault.LINK_LOST, Fault.FEEDBACK_STALE, Fault.DEVICE_FAULT, Fault.SERVO_DIED}


@pytest.mark.parametrize("harm", [kill, stop])
@pytest.mark.parametrize("name", ["ur", "dynamixel"])
def test_a_device_is_lost(tmp_path, name, harm):
    pytest.importorskip("rtde_control" if name == "ur" else "dynamixel_sdk")
    word = {"kill": "SIGKILL", "stop": "SIGSTOP, SIGCONT"}[harm.__name__]
    tally = Tally(
        f"`orientd sim {name}`: {word}", 60 + (name != "ur"),
        "fault in time and in words, limits in what was sent, status, reset, a motion",
    )  # fmt: skip

    def one(number, generator):
        rig.calls.late.clear()
        mend = None
        try:
            with rig.watched() as cycles:
                handle = rig.turn()
                time.sleep(generator.uniform(0.0, 1.5))
                if number % 3 == 1:
                    rig.robot.pause(rig.device)
                elif number % 3 == 2:
                    rig.robot.set_speed(0.5, rig.device)
                time.sleep(generator.uniform(0.0, 0.2))
                mend = harm(rig, generator)
                until(lambda: rig.state().state is State.FAULT, "the fault", 4.0)
                until(lambda: rig.state().fault_text, "the fault in words", 1.0)
            rig.check_sent(cycles)
            report = rig.state()
            assert report.fault in FAULTS, report.fault
            tally.met[report.fault.name.lower()] += 1
            assert handle.wait(5.0).outcome is Outcome.FAULT
        finally:
            if mend is not None:
                mend()
        _recover(rig)
        assert not rig.calls.late, "; ".join(rig.calls.late)

    def _recover(rig):
        end = time.monotonic() + 30.0
        while True:
            # Servos and robots need some time after their own stops until they can be unlocked.
            try:
                rig.robot.reset(rig.device)
                break
            except OrientdError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.3)
        until(lambda: rig.state().state is State.HOLDING, "holding", 10.0)
        rig.robot.set_speed(1.0, rig.device)
        assert rig.turn().wait(60.0).outcome is Outcome.DONE
        rig.servos.append(rig.state().servo_pid)
        assert not [pid for pid in rig.servos if pid != rig.servos[-1] and is_alive(pid)]

    with Rig(tmp_path, tally, name) as rig:
        rounds_of(f"sim-{name}-{harm.__name__}", tally, one)
