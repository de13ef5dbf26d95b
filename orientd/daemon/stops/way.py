"""The daemon's end of the process that takes stops: start it, tell it of servos, hear of stops."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orientd.daemon.access import Process, RolePolicy
from orientd.daemon.devices import DeviceEvent, EventKind
from orientd.daemon.stops.process import LINK_BYTES
from orientd.errors import DaemonError
from orientd.rpc import stop_socket

if TYPE_CHECKING:
    from orientd.daemon.cell import Cell
    from orientd.daemon.device import Device

_log = logging.getLogger(__name__)

_AGAIN = 0.5
"""Time after which the process is started again that has ended, s."""

_LOGGED = 1.0
"""Repeated stops of one user are written down as one within so long, s."""

_MOST_REPEATED = 1000

Record = Callable[..., object]
"""Records a stop, by keywords: its origin, the identity, the kind, devices and times."""


@dataclass
class _Repeated:
    """Stops of one user, of which the first is written down, and how many were the same."""

    since: float
    process: Process
    kind: str
    devices: list[str]
    times: int = 0


class StopWay:
    """The way of stops, apart from everything."""

    def __init__(self, path: Path, policy: RolePolicy, *, record: Record) -> None:
        """Listen beside the socket at *path*.

        Args:
            path: of the control socket.
            policy: who may come in.
            record: records stops.

        Raises:
            DaemonError: that is not possible.
        """
        self._path = stop_socket(path)
        self._policy, self._record = policy, record
        self._lock = threading.RLock()
        self._cell: Cell | None = None
        self._ready: dict[str, Device] = {}
        self._repeated: dict[tuple[object, ...], _Repeated] = {}
        self._closing = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._path.unlink(missing_ok=True)
            self._bind()
            self._listener.listen(4096)
            self._start()
        except OSError as error:
            self._listener.close()
            raise DaemonError(f"cannot listen at {self._path}: {error.strerror}") from error
        self._thread = threading.Thread(target=self._hear_all, name="stops", daemon=True)
        self._thread.start()

    def _bind(self) -> None:
        # By way of its directory: that path is never too long.
        directory = os.open(self._path.parent, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            self._listener.bind(f"/proc/self/fd/{directory}/{self._path.name}")
        finally:
            os.close(directory)
        self._let_reach()

    def _let_reach(self) -> None:
        self._path.chmod(0o666 if self._policy.admits_others else 0o600)

    def follow(self, cell: Cell) -> None:
        """Have the devices of *cell* stopped by this way from now on."""
        self._cell = cell
        cell.listeners.append(self._hear_device)
        cell.runs.hear_stops = self._hear
        self._begin()

    def admit(self, policy: RolePolicy) -> None:
        """Let other users and groups in from now on."""
        self._policy = policy
        self._let_reach()
        self._tell(policy.tables())

    def close(self) -> None:
        """Take no more stops."""
        self._closing.set()
        with self._lock, contextlib.suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._link.close()
        self._process.wait()
        self._listener.close()
        self._path.unlink(missing_ok=True)

    # The process

    def _start(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        descriptors = self._listener.fileno(), theirs.fileno()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "orientd.daemon.stops", *map(str, descriptors)],
                stdin=subprocess.DEVNULL,
                pass_fds=descriptors,
                process_group=0,
                cwd="/",
            )
        self._link = ours
        if self._cell is not None:
            self._begin()

    def _begin(self) -> None:
        """Tell the process all it needs before the first stop."""
        self._tell(self._policy.tables())
        for name in self._cell.devices if self._cell is not None else ():
            self._tell({"devices": [name]}, self._ready.get(name))
        self._tell({"go": True})

    def _tell(self, what: Mapping[str, Any], device: Device | None = None) -> None:
        with self._lock, contextlib.suppress(OSError, ValueError):
            descriptors = [] if device is None else [device.descriptor]
            socket.send_fds(self._link, [json.dumps(what).encode()], descriptors)

    def _hear_device(self, event: DeviceEvent, device: Device) -> None:
        if event.kind is EventKind.READY:
            self._ready[device.name] = device
            self._tell({"devices": [device.name]}, device)
        elif event.kind is EventKind.SERVO_DIED:
            self._ready.pop(device.name, None)
            self._tell({"devices": [device.name]})

    # Stops

    def _hear_all(self) -> None:
        while not self._closing.is_set():
            waiting = select.poll()
            waiting.register(self._link, select.POLLIN)
            waiting.poll(_LOGGED * 1e3)
            self._hear()
            self._write_repeated()
            if self._process.poll() is not None and not self._closing.wait(_AGAIN):
                _log.error("stops: the process that takes them has ended; it is started again")
                with self._lock, contextlib.suppress(OSError):
                    self._link.close()
                    self._start()

    def _hear(self) -> None:
        """Note the stops that were made since this was last called."""
        with self._lock, contextlib.suppress(OSError, ValueError):
            while content := self._link.recv(LINK_BYTES, socket.MSG_DONTWAIT):
                self._take(json.loads(content))

    def _take(self, told: dict[str, Any]) -> None:
        process = Process(told["pid"], told["uid"], tuple(told["gids"]))
        kind, devices = told["kind"], told["devices"]
        if self._cell is not None:
            self._cell.runs.note_stop(devices, f"stopped by {self._name(process)}")
        # How often somebody stops is not limited; what is written of it is.
        same = (process.uid, kind, *devices)
        if same in self._repeated:
            self._repeated[same].times += 1
        elif len(self._repeated) < _MOST_REPEATED:
            self._repeated[same] = _Repeated(time.monotonic(), process, kind, devices)
            self._write(self._repeated[same], times=1)

    def _name(self, process: Process) -> str:
        """Return who *process* is, for people."""
        return str(self._policy.identify(process) or f"user {process.uid}")

    def _write_repeated(self) -> None:
        now = time.monotonic()
        with self._lock:
            for same, one in list(self._repeated.items()):
                if now - one.since >= _LOGGED:
                    del self._repeated[same]
                    if one.times:
                        self._write(one, times=one.times)

    def _write(self, one: _Repeated, *, times: int) -> None:
        origin, identity = f"unix, process {one.process.pid}", f"user:{one.process.uid}"
        self._record(
            origin=origin, identity=identity, kind=one.kind, devices=one.devices, times=times
        )
        of, who = ", ".join(one.devices), self._name(one.process)
        again = f", {times} times more" if times > 1 else ""
        _log.info("%s: %s by %s%s", of, one.kind, who, again)
