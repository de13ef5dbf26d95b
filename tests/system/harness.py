"""Run a real daemon in its own process, on its own socket."""

from __future__ import annotations

import contextlib
import os
import signal
import socket as sockets
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import grpc
import numpy as np
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from grpclib.health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from judge import Judge, judged
from motions import motion_of, through

from orientd import connect, motion_file
from orientd.driver import Setpoint
from orientd.errors import OrientdError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub
from orientd.stream.records import CYCLE_RECORD, Cycle, CycleFlag, unpack_cycle
from orientd_loopback import read_recording

DEVICE = "arm"
VELOCITY, ACCELERATION, JERK = 2.5, 17.0, 8500.0
LIMITS = {"velocity": VELOCITY, "acceleration": ACCELERATION, "jerk": JERK}

REST = 3
"""Setpoints at one place that are rest."""

DEVICE_PRIORITY = 70
"""SCHED_FIFO priority of an emulated device."""


def free_port():
    """Return a TCP port that nobody listens at."""
    with sockets.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def until(condition, what, seconds=30.0):
    """Wait until *condition* returns a true value, and return it.

    The timeout is long because a process on a busy machine may wait for seconds.  The longer it
    takes, the less often this looks: each look costs both sides time.
    """
    begun = time.monotonic()
    while (waited := time.monotonic() - begun) < seconds:
        found = condition()
        if found:
            return found
        time.sleep(min(0.01, 0.002 + 0.01 * waited))
    raise AssertionError(f"{what}: not within {seconds} s")


def request_of(name: str) -> type[Message]:
    """Return the class of the request of a call of the control socket."""
    calls = pb.DESCRIPTOR.services_by_name["Control"].methods_by_name
    return GetMessageClass(calls[name].input_type)


class Machine:
    """How tests reach processes: here real ones.  A world in virtual time has its own.

    Attributes:
        is_patient: whether longer timeouts than the shipped ones keep a busy machine from faults.
    """

    is_patient = True

    def start_daemon(self, it: DaemonProcess) -> subprocess.Popen[str]:
        """Start a daemon and wait until it is ready."""
        process = subprocess.Popen(
            [*it.prefix, sys.executable, "-m", "orientd", "run", *it.arguments],
            stdout=subprocess.PIPE,
            stderr=it.log,
            text=True,
            env={
                **os.environ,
                "XDG_STATE_HOME": str(it.folder / "state"),
                "PYTHONFAULTHANDLER": "1",
                **it.environment,
            },
        )
        line = process.stdout.readline()
        if "ready at" not in line:
            process.kill()
            process.communicate()
            raise AssertionError(line, (it.folder / "log").read_text())
        return process

    def channel(self, socket: Path) -> grpc.Channel:
        """Return a separate channel: others may still try to reach a dead daemon."""
        options = [("grpc.use_local_subchannel_pool", 1)]
        return grpc.insecure_channel(f"unix:{socket}", options=options)

    def is_alive(self, pid: int) -> bool:
        """Whether a process runs; a zombie does not."""
        try:
            return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
        except (FileNotFoundError, ProcessLookupError):
            return False

    def children(self, pid: int) -> set[int]:
        """Return the running processes that any thread of *pid* has started."""
        tasks = Path(f"/proc/{pid}/task").glob("*/children")
        found = {int(child) for task in tasks for child in task.read_text().split()}
        return set(filter(self.is_alive, found))

    def kill(self, pid: int, number: int) -> None:
        """Send a signal."""
        os.kill(pid, number)

    def run_first(self, pid: int) -> None:
        """Give a process the highest priority, if the system permits it."""
        for task in os.listdir(f"/proc/{pid}/task"):
            with contextlib.suppress(PermissionError, ProcessLookupError):
                os.sched_setscheduler(int(task), os.SCHED_FIFO, os.sched_param(DEVICE_PRIORITY))


MACHINE = Machine()


def channel_to(socket: Path) -> grpc.Channel:
    """Return a channel to a daemon."""
    return MACHINE.channel(socket)


def health(channel: grpc.Channel) -> SimpleNamespace:
    """Return the calls of the standard health service, with the messages of the daemon's library.

    A process can load only one library's messages of one name.
    """
    kinds = {
        "request_serializer": HealthCheckRequest.SerializeToString,
        "response_deserializer": HealthCheckResponse.FromString,
    }
    service = "/grpc.health.v1.Health"
    return SimpleNamespace(
        Check=channel.unary_unary(f"{service}/Check", **kinds),
        Watch=channel.unary_stream(f"{service}/Watch", **kinds),
    )


def install_driver(site: Path, name: str, driver: str, text: str) -> None:
    """Install a driver in a folder: its module and its entry point are called *name*.

    Args:
        site: the folder; it is made if need be.
        name: of the driver.
        driver: its class.
        text: of the module.
    """
    install(site, name, f"[orientd.drivers]\n{name} = {name}:{driver}\n", text)


def install(site: Path, name: str, entries: str, text: str) -> None:
    """Install a package of one module in a folder, with what its ``entry_points.txt`` has."""
    described = site / f"{name}-1.dist-info"
    described.mkdir(parents=True)
    (described / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (described / "entry_points.txt").write_text(entries)
    (site / f"{name}.py").write_text(text)


class Lines:
    """The lines that a process prints on a stream, as they come."""

    def __init__(self, stream) -> None:
        self._lines, self._stream = [], stream
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self._stream:
            self._lines.append(line.rstrip("\n"))

    def close(self) -> None:
        """Wait for the last line, and close the stream."""
        self._thread.join()
        self._stream.close()

    def forget(self) -> None:
        """Forget the lines so far."""
        self._lines.clear()

    def last(self) -> str:
        """Return the next line and forget it."""
        until(lambda: self._lines, "a line")
        return self._lines.pop(0)

    def await_line(self, line: str) -> None:
        """Wait until a line was printed."""
        until(lambda: line in self._lines, line)

    def __len__(self) -> int:
        return len(self._lines)


class CycleLog:
    """Every cycle of a daemon's only device since this began, gathered by a client of its own."""

    def __init__(self, socket: Path) -> None:
        self._robot = connect(socket)
        self._observer = self._robot.observe()
        self._packed: list[bytes] = []
        self._thread = threading.Thread(target=self._gather, daemon=True)
        self._thread.start()
        until(lambda: self._packed, "the first cycles")

    def _gather(self) -> None:
        with contextlib.suppress(OrientdError):
            for packed, _ in self._observer.records():
                if packed:
                    self._packed.append(packed)

    def cycles(self) -> list[Cycle]:
        """Wait for the newest cycle that the daemon has, and return all of them."""
        (device,) = self._robot.state().devices.values()

        def newest() -> Cycle:
            return unpack_cycle(self._packed[-1], len(self._packed[-1]) - CYCLE_RECORD.size)

        until(lambda: newest().index >= device.cycle.index, "the newest cycle")
        packed = b"".join(self._packed)
        return [unpack_cycle(packed, at) for at in range(0, len(packed), CYCLE_RECORD.size)]

    def close(self) -> None:
        """End the gathering."""
        self._observer.close()
        self._thread.join(10.0)
        self._robot.close()


def is_from_rest(cycle: Cycle) -> bool:
    """Return whether motion resumes in this cycle, after the servo process did not run."""
    return bool(cycle.flags & CycleFlag.FROM_REST)


class DaemonProcess:
    """``orientd run`` with one loopback device that records its setpoints.

    No client renews its lease, so the lease lasts as long as a test.
    """

    def __init__(
        self,
        folder: Path,
        *,
        rate_hz: float = 500.0,
        options: str = "",
        arguments: Sequence[str] = (),
        memory: float = 60.0,
        lease: float = 120.0,
        patience: float | None = 5.0,
        others: Sequence[str] = (),
    ) -> None:
        """Configure a daemon in *folder*.

        *patience* replaces the timeouts of stall, heartbeat and feedback, s, so a busy machine
        causes no fault.  ``None``, and virtual time, keep the defaults.  *others* are more loopback
        devices, without recording.
        """
        folder.mkdir(exist_ok=True)
        self.arguments = ["--config", str(folder / "config.toml"), *arguments]
        self.folder = folder
        self.socket = folder / "control.sock"
        self.recording = folder / "sent"
        self.report = folder / "state" / "orientd" / f"servo-{DEVICE}.json"
        self.config = folder / "config.toml"
        is_patient = patience is not None and MACHINE.is_patient
        names = ("stall", "heartbeat", "feedback") if is_patient else ()
        patient = "".join(f"{name}_timeout = {patience!r}\n" for name in names)
        self.config.write_text(
            f'[daemon]\nsocket = "{self.socket}"\nlease_seconds = {lease!r}\n'
            f"[recorder]\nseconds = {memory!r}\n"
            f'[devices.{DEVICE}]\ndriver = "loopback"\nrate_hz = {rate_hz!r}\n{patient}'
            f'[devices.{DEVICE}.options]\nrecord = "{self.recording}"\n{options}\n'
            + "".join(f'[devices.{name}]\ndriver = "loopback"\n{patient}' for name in others)
        )
        self.period = round(1e9 / rate_hz) * 1e-9
        self.prefix: tuple[str, ...] = ()
        self.environment: dict[str, str] = {}

    def __enter__(self) -> DaemonProcess:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def import_from(self, folder: Path) -> None:
        """Let the daemon and its processes import modules of *folder*."""
        paths = [str(folder), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        self.environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))

    def start(self, *, takes_lease: bool = True) -> None:
        """Start the daemon, wait until it is ready, and take the lease of its devices."""
        self.log = (self.folder / "log").open("ab")
        self.process = MACHINE.start_daemon(self)
        try:
            self.channel = channel_to(self.socket)
            self.stub = control_stub(self.channel)
            if takes_lease:
                request = pb.AcquireLeaseRequest(holder="test")
                self.token = self.stub.AcquireLease(request).lease.token
        except BaseException:
            # If a test cannot begin, its end does not stop the daemon either.
            self.process.kill()
            self.process.communicate()
            self.log.close()
            raise

    def end(self) -> int:
        """Terminate the daemon and return its exit code."""
        self.channel.close()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(30.0)
        is_stuck = self.process.poll() is None
        if is_stuck:
            self.process.send_signal(signal.SIGABRT)  # it prints the stacks of its threads
            self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
        self.log.close()
        where = (self.folder / "log").read_text()[-4000:] if is_stuck else ""
        assert not is_stuck, f"the daemon did not end within 30 s: {where}"
        return self.process.returncode

    def device(self) -> pb.DeviceReport:
        """Return the device's state as the daemon reports it."""
        return self.stub.GetState(pb.GetStateRequest(device=DEVICE)).devices[0]

    def planners(self) -> set[int]:
        """Return the processes that plan, and the one that starts them if there is one."""
        found = children(self.process.pid) - {self.device().servo_pid}
        return found.union(*map(children, found))

    def move(self, motion: bytes, columns: bytes = b""):
        """Begin a motion and return the stream of its progress after the start."""
        request = pb.MoveRequest(
            lease_token=self.token, device=DEVICE, motion=motion, columns=columns
        )
        # gRPC cancels a call without references, which ends the motion.
        self.stream = self.stub.Move(request)
        self.started = next(iter(self.stream)).started
        return self.stream

    def renew(self) -> None:
        """Renew the lease for its full time."""
        self.stub.RenewLease(pb.RenewLeaseRequest(token=self.token))

    def judged(self, begin: int = 0) -> tuple[list[str], Judge]:
        """Return what the setpoints from *begin* on violate, and their judge.

        Where motion resumes after a stall it begins at rest.
        """
        return judged(read_recording(self.recording)[begin:], LIMITS, self.period)

    def at_rest(self) -> int:
        """Wait for rest; return how many setpoints there are, but for the last ones, at rest.

        A motion is done as soon as the servo has its end, a few setpoints before rest.
        """

        def sent() -> Sequence[object]:
            found = read_recording(self.recording)
            places = {(one.q, one.position) for one in found[-REST:]}
            return found if len(found) >= REST and len(places) == 1 else []

        return len(until(sent, "rest")) - REST

    def assert_limits_kept(self, begin: int = 0) -> None:
        """Check that the setpoints from *begin* on keep the default limits."""
        violations, _ = self.judged(begin)
        assert not violations, violations[:5]

    def sent(self) -> np.ndarray:
        """Return the orientations that the driver has recorded so far, shape (n, 4)."""
        return np.array([setpoint.q for setpoint in read_recording(self.recording)])


def spin(seconds: float, *, start=(0.0, 0.0, 0.4), end=(0.3, 0.0, 0.5)) -> bytes:
    """Return a timed motion about changing axes, with velocity at both ends."""
    times = np.linspace(0.0, seconds, max(3, round(seconds / 0.4) + 1))
    x, y, z = (
        0.3 * np.sin(0.8 * times),
        0.2 * np.sin(1.1 * times),
        0.4 * times + 0.1 * np.sin(times),
    )
    keyframes = [
        {"time": t, "rotation_vector": vector}
        for t, vector in zip(times.tolist(), np.stack([x, y, z], axis=1).tolist(), strict=True)
    ]
    velocities = {"start_velocity": list(start), "end_velocity": list(end)}
    return motion_of(*keyframes, **velocities, velocity_frame="body", approach=True)


def nudge(angle: float) -> bytes:
    """Return a small turn, as fast as the limits allow."""
    return through([(0, 0, 0), (0.5 * angle, 0, 0), (angle, 0, angle)], approach=True)


def planned_path(daemon: DaemonProcess, motion: bytes) -> Motion:
    """Return the motion as the daemon has planned it, from the loopback's first orientation."""
    return plan(
        motion_file.loads(motion),
        start=State.at_rest((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        limits=DEFAULT_LIMITS,
        period=daemon.period,
    )


def _setpoints(q: np.ndarray, period: float) -> list[Setpoint]:
    """Return orientations as setpoints, one in each period."""
    return [Setpoint(round(k * period * 1e9), tuple(one)) for k, one in enumerate(q.tolist(), 1)]


def peaks(q: np.ndarray, period: float) -> tuple[float, float, float]:
    """Return the largest velocity, acceleration and jerk by backward differences, from rest."""
    _, judge = judged(_setpoints(q, period), {}, period)
    return judge.peaks["velocity"], judge.peaks["acceleration"], judge.peaks["jerk"]


def assert_limits_kept(
    q: np.ndarray,
    period: float,
    limits: dict[str, float] | None = None,
    *,
    is_moving: bool = False,
) -> None:
    """Check that setpoints keep limits, the default ones unless others are given."""
    violations, _ = judged(_setpoints(q, period), limits or LIMITS, period, is_moving=is_moving)
    assert not violations, violations[:5]


def is_alive(pid: int) -> bool:
    """Whether a process runs."""
    return MACHINE.is_alive(pid)


def run_first(pid: int) -> None:
    """Give an emulated device the highest priority, if the system permits it.

    A real device has a processor of its own.  On a busy machine an emulated one would answer too
    late, or would not empty its line.
    """
    MACHINE.run_first(pid)


def children(pid: int) -> set[int]:
    """Return the running processes that any thread of *pid* has started."""
    return MACHINE.children(pid)


def resident_kib(pid: int, kind: str = "VmRSS") -> int:
    """Return a process's resident memory, KiB: all of it, or one kind as ``/proc`` calls it."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith(f"{kind}:"):
            return int(line.split()[1])
    raise AssertionError(f"no process {pid}")
