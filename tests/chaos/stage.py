"""A daemon under fault injection: the stage measures every call and checks the state afterwards."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import threading
import time
from pathlib import Path

import grpc
import numpy as np
from command_line import inside
from harness import (
    DEVICE,
    DaemonProcess,
    channel_to,
    is_alive,
    nudge,
    request_of,
    until,
)
from tally import Tally, rounds_of

from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

LONGEST = 1.0
"""Longest permitted duration of a call, s."""

RESTART = "Reset, new servo process"
LONGEST_RESTART = 10.0
"""Longest permitted duration of a reset that starts an interpreter, s."""

FLIGHT_RECORDER = 100.0
"""Longest time for the flight recorder to write and end, at its low priority, s."""

ATTEMPTS = 5
"""Most attempts if the machine is busy."""

STARVED = ("heartbeat_lost", "path_starved")
"""Faults of a servo whose daemon has had no processor for :data:`LONGEST`."""

_MARK = "ORIENTD_CHAOS_MARK"
_marks = itertools.count()


def waiting(*pids: int) -> dict[str, int]:
    """Return the time that each thread of the processes has waited for a processor, ns."""
    found = {}
    for pid in pids:
        with contextlib.suppress(OSError):
            for task in os.listdir(f"/proc/{pid}/task"):
                with contextlib.suppress(OSError):
                    path = Path(f"/proc/{pid}/task/{task}/schedstat")
                    found[task] = int(path.read_text().split()[1])
    return found


class Calls:
    """Measures the duration of calls.

    If a call waits for a stopped daemon, its time begins when the daemon continues.  From the time
    of a long call :meth:`measure` subtracts the longest waits for a processor: that of one thread
    here and that of one thread of the daemon.
    """

    def __init__(self, tally: Tally, daemon_pid=lambda: 0) -> None:
        self._tally = tally
        self._daemon_pid = daemon_pid
        self.late: list[str] = []
        self.longest = LONGEST
        self.went_on = 0.0

    def measure(self, name, work):
        """Do *work* and note its duration, whether or not it fails."""
        begun = time.monotonic()
        pids = (os.getpid(), self._daemon_pid())
        before = [waiting(pid) for pid in pids]
        try:
            return work()
        finally:
            took = time.monotonic() - max(begun, self.went_on)
            if took > 0.5 * LONGEST:
                took -= sum(longest_wait(*pair) for pair in zip(pids, before, strict=True))
            if took > self._tally.slowest[1]:
                self._tally.slowest = (name, took)
            if took > (LONGEST_RESTART if name == RESTART else self.longest):
                self.late.append(f"{name} took {took:.2f} s")


def longest_wait(pid: int, before: dict[str, int]) -> float:
    """Return the longest wait of a thread of a process for a processor since *before*, s."""
    now = waiting(pid)
    waits = (ns - before.get(task, ns) for task, ns in now.items())
    return 1e-9 * max(waits, default=0)


class Probe(threading.Thread):
    """Requests the state all the time."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(daemon=True)
        self._stage = stage
        self._ending = threading.Event()
        self.answers = 0

    def run(self) -> None:
        stage = self._stage
        with channel_to(stage.daemon.socket) as channel:
            stub = control_stub(channel)
            while not self._ending.wait(0.02):
                with contextlib.suppress(grpc.RpcError):
                    stage.calls.measure(
                        "GetState", lambda: stub.GetState(pb.GetStateRequest(), timeout=30)
                    )
                    self.answers += 1

    def end(self) -> None:
        self._ending.set()
        self.join()


class Stage:
    """A daemon with a loopback device, for one round after another."""

    def __init__(
        self, folder: Path, tally: Tally, *, prefix=(), environment=None, lease_seconds=30.0
    ) -> None:
        self.mark = f"{os.getpid()}-{next(_marks)}"
        self.tally = tally
        self.calls = Calls(tally, lambda: self.daemon.process.pid)
        self.daemon = DaemonProcess(folder, lease=lease_seconds, patience=None)
        self.daemon.prefix = tuple(prefix)
        self.daemon.environment = {_MARK: self.mark, **(environment or {})}
        self.streams: list = []
        self._is_warm = False
        self._waited: dict[str, int] = {}
        self._side = 1.0

    def __enter__(self) -> Stage:
        self.shared = set(os.listdir("/dev/shm"))
        try:
            self.start()
        except BaseException:
            self._kill()
            raise
        return self

    def __exit__(self, kind, *_) -> None:
        self.daemon.end()
        until(lambda: not self.family(), f"processes are left: {self.family()}", 5.0)
        if kind is None:
            left = [name.name for name in self.daemon.folder.glob("*.sock*")]
            assert not left, f"left behind: {left}"

    def start(self) -> None:
        """Start the daemon, and make it load all modules of a first motion."""
        self.calls.went_on = float("inf")
        self.daemon.start()
        self._is_warm = False
        self.move_once()
        self.calls.went_on = time.monotonic()

    def family(self) -> dict[int, str]:
        """Return the processes that this daemon or an earlier one has started."""
        mark, found = f"{_MARK}={self.mark}".encode(), {}
        for path in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if mark in (path / "environ").read_bytes().split(b"\0") and is_alive(
                    int(path.name)
                ):
                    program, *words = (path / "cmdline").read_bytes().split(b"\0")
                    words.insert(0, program.rpartition(b"/")[2])
                    found[int(path.name)] = b" ".join(words).decode(errors="replace").strip()
        return found

    # Commands

    def call(self, name, request):
        """Call the daemon, and measure the call."""
        stub = getattr(self.daemon.stub, name)
        return self.calls.measure(name, lambda: stub(request, timeout=30))

    def command(self, name, **fields):
        """Send a command with the lease, and measure the call."""
        kind = request_of(name)
        if "lease_token" in kind.DESCRIPTOR.fields_by_name:
            fields["lease_token"] = self.daemon.token
        stub, request = getattr(self.daemon.stub, name), kind(device=DEVICE, **fields)
        is_restart = name == "Reset" and not self.servo
        return self.calls.measure(
            RESTART if is_restart else name, lambda: stub(request, timeout=30)
        )

    def begin(self, motion, **fields):
        """Begin a motion, and return its stream after the start."""
        request = pb.MoveRequest(
            lease_token=self.daemon.token, device=DEVICE, motion=motion, **fields
        )
        stream = self.daemon.stub.Move(request, timeout=60)
        self.streams.append(stream)
        # The first motion of a daemon loads the planner.
        if self._is_warm:
            self.calls.measure("Move", lambda: next(stream))
        else:
            with self._lease_kept():
                next(stream)
        self._is_warm = True
        return stream

    @contextlib.contextmanager
    def _lease_kept(self):
        """Renew the lease meanwhile."""
        ended = threading.Event()

        def renew():
            while not ended.wait(0.3):
                self.daemon.renew()

        thread = threading.Thread(target=renew, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def device(self) -> pb.DeviceReport:
        """Return the device's state as the daemon reports it."""
        return self.call("GetState", pb.GetStateRequest(device=DEVICE)).devices[0]

    def status(self) -> dict:
        """Return the report of `orientd status`."""
        told = inside("status", "--socket", self.daemon.socket, "--json")
        assert told.returncode == 0, told
        return json.loads(told.stdout)

    @property
    def servo(self) -> int:
        """The process ID of the servo."""
        return self.device().servo_pid

    # What must hold

    def check_sent(self) -> None:
        """Check all setpoints since the last check; the device must be at rest."""
        self.daemon.assert_limits_kept()
        os.truncate(self.daemon.recording, 0)

    def rests(self) -> None:
        """Wait until nothing moves, and check that the device holds the last setpoint."""
        until(lambda: self.device().state in (pb.STATE_HOLDING, pb.STATE_FAULT), "rest", 8.0)
        time.sleep(0.01)
        sent = self.daemon.sent()
        assert len(sent) < 2 or np.array_equal(sent[-1], sent[-2]), "rest, but it moves"

    def check_truth(self, *, faults, holder="test") -> str:
        """Check that the reported state is true, and return the reported fault."""
        told = self.status()
        device = told["devices"][DEVICE]
        assert told["daemon"]["pid"] == self.daemon.process.pid
        holders = [lease["holder"] for lease in told["daemon"]["leases"]]
        assert holders == [holder] * bool(holder), told["daemon"]
        met = fault = device["fault"]
        if fault not in faults and self.was_starved(self._waited):
            met = f"{fault} while the daemon waited for a processor"
        else:
            assert fault in faults, (fault, device["fault_text"])
        is_fault = fault != "none"
        assert device["state"] == ("fault" if is_fault else "holding"), device
        assert bool(device["fault_text"]) == is_fault, device
        pid = device["servo_pid"]
        servos = [pid for pid, words in self.family().items() if "orientd.servo" in words]
        assert servos == ([pid] if pid else []), (pid, servos)
        self.tally.met[met] += 1
        return fault

    def was_starved(self, waited: dict[str, int]) -> bool:
        """Whether the daemon had no processor since *waited*, and the fault says so.

        The servo reports such a fault correctly, but the harm is not its cause.
        """
        fault = pb.Fault.Name(self.device().fault).removeprefix("FAULT_").lower()
        return fault in STARVED and longest_wait(self.daemon.process.pid, waited) > LONGEST

    def check_clean(self) -> None:
        """Check that only the daemon, its planners and one servo run."""
        expected = {self.daemon.process.pid, self.servo}
        end = time.monotonic() + FLIGHT_RECORDER
        # The flight recorder ends by itself once it has written its file.
        while orphans := {
            pid: words
            for pid, words in self.family().items()
            if pid not in expected and not self._is_of_daemon(pid, words)
        }:
            assert time.monotonic() < end, f"still there: {orphans}"
            time.sleep(0.005)
        new = set(os.listdir("/dev/shm")) - self.shared
        assert not {name for name in new if "orientd" in name}, new

    def _is_of_daemon(self, pid: int, words: str) -> bool:
        """Whether a process plans for the daemon that runs."""
        parent = parent_of(pid)
        # A planner, or the process from which planners fork.
        return "orientd.daemon.planners" in words and self.daemon.process.pid in (
            parent, parent_of(parent),
        )  # fmt: skip

    def move_once(self) -> None:
        """Make a small motion, and check that it is done."""
        self._side = -self._side
        *_, last = self.begin(nudge(0.05 * self._side))
        assert last.summary.outcome == pb.OUTCOME_DONE, last
        self.streams.clear()

    def await_fault(self, seconds: float = 2.0) -> None:
        """Wait until the daemon reports a fault."""
        until(lambda: self.device().state == pb.STATE_FAULT, "the fault", seconds)

    def come_to_rest(self) -> None:
        """Stop a motion that still runs, as every user may."""
        self.call("Stop", pb.StopRequest(device=DEVICE))
        self.rests()

    def settle(self, *, faults, holder="test") -> None:
        """Check after the harm the reported state, the limits of the setpoints, and recovery."""
        self.streams.clear()
        self.check_truth(faults=faults, holder=holder)
        self.check_sent()
        if not holder:
            request = pb.AcquireLeaseRequest(holder="test")
            self.daemon.token = self.call("AcquireLease", request).lease.token
        self.recover()

    def recover(self) -> None:
        """Recover the device as a user would, and check that it moves again."""
        for _ in range(ATTEMPTS):
            self.call("RenewLease", pb.RenewLeaseRequest(token=self.daemon.token))
            if self.device().state == pb.STATE_FAULT:
                self.command("Reset")
            until(lambda: self.device().state == pb.STATE_HOLDING, "holding", 5.0)
            self.command("SetSpeed", speed=1.0)
            waited = waiting(self.daemon.process.pid)
            try:
                self.move_once()
                break
            except AssertionError:
                if not self.was_starved(waited):
                    raise
                self.tally.met["repeated because the daemon waited for a processor"] += 1
        self.check_sent()
        self.check_clean()
        assert not self.calls.late, "; ".join(self.calls.late)

    def again(self) -> None:
        """Replace the daemon after a failure, whatever state the old one was in."""
        self.calls.late.clear()
        self.streams.clear()
        self._kill()
        with contextlib.suppress(FileNotFoundError):
            os.truncate(self.daemon.recording, 0)
        self.start()
        os.truncate(self.daemon.recording, 0)
        self.calls.late.clear()

    def _kill(self) -> None:
        with contextlib.suppress(Exception):
            self.daemon.channel.close()
            self.daemon.process.stdout.close()
            self.daemon.log.close()
        for pid in self.family():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.daemon.process.wait()
        until(lambda: not self.family(), "the end of all")

    @contextlib.contextmanager
    def round(self):
        """Run one round under a probe, and replace the daemon if it fails."""
        os.truncate(self.daemon.recording, 0)
        self.calls.late.clear()
        self._waited = waiting(self.daemon.process.pid)
        probe = Probe(self)
        probe.start()
        try:
            yield
            probe.end()
            assert not self.calls.late, "; ".join(self.calls.late)
        except Exception:
            probe.end()
            print((self.daemon.folder / "log").read_text()[-3000:])
            self.again()
            raise


def rehearse(folder: Path, name: str, tally: Tally, harm, **settings) -> None:
    """Do harm to one stage, round after round.

    Args:
        folder: the daemon's folder.
        name: name of the fault.
        tally: results of its rounds.
        harm: function that does the harm and checks the effect.  Its arguments are the stage, the
            round's number and its generator.
        settings: options of the stage.
    """
    with Stage(folder, tally, **settings) as stage:

        def one(number, generator):
            with stage.round():
                harm(stage, number, generator)

        rounds_of(name, tally, one)


def parent_of(pid: int) -> int:
    """Return the parent of a process, or 0 if the process has ended."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError):
        return 0
