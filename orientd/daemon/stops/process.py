"""The process that takes stops: from a socket of its own, straight into the servos' memory.

It does nothing else, and waits for nobody: not for the daemon, whose event loop may be blocked, nor
for a client that says nothing, nor for a disk.  Whoever may come in to the daemon may stop.  A
request is one line of JSON, ``{"kind": "stop", "device": "arm"}``, where the kind is ``stop`` or
``halt`` and no device is all of them; ``{"kind": "hello"}`` only asks whether one may come in.  The
answer is one line, and the end.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import selectors
import signal
import socket
import time
from typing import Any

from orientd.daemon.access import Process, peer_process
from orientd.servo import set_scheduling
from orientd.stream import (
    HALTS_WORD,
    PAGE,
    STOPS_WORD,
    TAKEN_AT_WORD,
    TAKEN_WORD,
    ServoState,
)

LINK_BYTES = 64 * 1024
"""The longest message of the daemon, or to it."""

REQUEST_BYTES = 512
SILENCE = 1.0
"""How long somebody may take to say what they want, s."""

MOST_WAITING = 200
"""Callers who have not said it yet; of more, the one that has waited longest is hung up on."""

TAKING = 0.3
"""How long a servo may take to take a stop before it is said not to answer, s."""

PRIORITY = 20
"""Of SCHED_FIFO, where the process may have it."""

_POLL = 0.001


class _Servo:
    """The memory of one servo process, of which this one writes two words."""

    def __init__(self, descriptor: int) -> None:
        self._map = mmap.mmap(descriptor, PAGE)
        os.close(descriptor)
        self.pulse = memoryview(self._map).cast("Q")

    def stop(self, *, is_quickest: bool) -> int:
        """Ask for a stop; return its number."""
        number = self.pulse[STOPS_WORD] + 1
        if is_quickest:
            self.pulse[HALTS_WORD] = number
        self.pulse[STOPS_WORD] = number
        return number

    def close(self) -> None:
        self.pulse.release()


class _Caller:
    """Somebody who came, and what they want."""

    def __init__(self, connection: socket.socket, process: Process) -> None:
        self.connection = connection
        self.process = process
        self.since = time.monotonic()
        self.said = b""
        self.asked: dict[str, tuple[_Servo | None, int]] = {}


class _Stops:
    def __init__(self, listener: socket.socket, link: socket.socket) -> None:
        self._listener, self._link = listener, link
        self._users: set[int] = set()
        self._groups: set[int] = set()
        self._servos: dict[str, _Servo | None] = {}
        self._waiting: dict[socket.socket, _Caller] = {}
        self._stopping: list[_Caller] = []
        self._selector = selectors.DefaultSelector()
        for one in (listener, link):
            one.setblocking(False)
        self._selector.register(link, selectors.EVENT_READ)
        self._has_ended = False

    def run(self) -> None:
        """Take stops until the daemon is gone."""
        while not self._has_ended:
            timeout = _POLL if self._stopping else SILENCE if self._waiting else None
            for key, _ in self._selector.select(timeout):
                if key.fileobj is self._link:
                    self._hear_daemon()
                elif key.fileobj is self._listener:
                    self._meet()
                elif key.fileobj in self._waiting:
                    self._read(self._waiting[key.fileobj])
            self._look()

    def _hear_daemon(self) -> None:
        with contextlib.suppress(BlockingIOError):
            content, descriptors, _, _ = socket.recv_fds(self._link, LINK_BYTES, 1)
            if not content:
                self._has_ended = True
                return
            told = json.loads(content)
            if "users" in told:
                self._users, self._groups = set(told["users"]), set(told["groups"])
            if "go" in told:
                self._selector.register(self._listener, selectors.EVENT_READ)
            for name in told.get("devices", ()):
                before = self._servos.get(name)
                self._servos[name] = _Servo(descriptors[0]) if descriptors else None
                if before is not None and not any(name in one.asked for one in self._stopping):
                    before.close()

    def _meet(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                try:
                    connection.setblocking(False)
                    caller = _Caller(connection, peer_process(connection))
                except OSError:
                    connection.close()
                    continue
                who = caller.process
                if who.uid not in self._users and not self._groups & set(who.gids):
                    self._answer(caller, {"refused": f"user {who.uid} is not admitted"})
                    continue
                if len(self._waiting) >= MOST_WAITING:
                    self._hang_up(next(iter(self._waiting.values())))
                self._waiting[connection] = caller
                self._selector.register(connection, selectors.EVENT_READ)
                self._read(caller)

    def _read(self, caller: _Caller) -> None:
        try:
            more = caller.connection.recv(REQUEST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            more = b""
        caller.said += more
        if not more or len(caller.said) > REQUEST_BYTES:
            self._hang_up(caller)
        elif b"\n" in caller.said:
            self._leave(caller)
            self._obey(caller)

    def _obey(self, caller: _Caller) -> None:
        kind = device = None
        with contextlib.suppress(ValueError, AttributeError):
            said = json.loads(caller.said)
            kind, device = said.get("kind"), said.get("device", "")
        if kind == "hello":
            self._answer(caller, {"admitted": caller.process.uid})
            return
        if kind not in ("stop", "halt") or not isinstance(device, str):
            self._answer(caller, {"wrong": "expected a stop or a halt"})
            return
        if device and device not in self._servos:
            expected = ", ".join(self._servos)
            self._answer(caller, {"unknown": f"expected one of {expected}, got {device!r}"})
            return
        for name in [device] if device else list(self._servos):
            servo = self._servos[name]
            number = 0 if servo is None else servo.stop(is_quickest=kind == "halt")
            caller.asked[name] = servo, number
        caller.since = time.monotonic()
        self._stopping.append(caller)
        who = caller.process
        note = {"kind": kind, "devices": list(caller.asked), "pid": who.pid, "uid": who.uid,
                "gids": who.gids}  # fmt: skip
        # A daemon that does not hear of it is told by what the servo does.
        with contextlib.suppress(OSError):
            self._link.send(json.dumps(note).encode())

    def _look(self) -> None:
        """Answer those whose stops were taken, and hang up on those who say nothing."""
        now = time.monotonic()
        for caller in list(self._stopping):
            is_taken = all(
                servo is None or servo.pulse[TAKEN_WORD] >= number
                for servo, number in caller.asked.values()
            )
            if is_taken or now > caller.since + TAKING:
                self._stopping.remove(caller)
                told = [_met(name, *asked) for name, asked in caller.asked.items()]
                self._answer(caller, {"devices": told})
        for caller in list(self._waiting.values()):
            if now < caller.since + SILENCE:
                break
            self._hang_up(caller)

    def _answer(self, caller: _Caller, answer: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            caller.connection.send(json.dumps(answer).encode() + b"\n")
        caller.connection.close()

    def _leave(self, caller: _Caller) -> None:
        del self._waiting[caller.connection]
        self._selector.unregister(caller.connection)

    def _hang_up(self, caller: _Caller) -> None:
        self._leave(caller)
        caller.connection.close()


def _met(name: str, servo: _Servo | None, number: int) -> dict[str, Any]:
    """Return what a stop has met, as it is answered; no state where nobody took it."""
    if servo is None or servo.pulse[TAKEN_WORD] < number:
        return {"name": name, "state": None}
    word = servo.pulse[TAKEN_AT_WORD]
    return {"name": name, "state": ServoState(word >> 32).name, "motion": word & 0xFFFFFFFF}


def main(listener: int, link: int) -> None:
    """Take stops at *listener*; the daemon is at the other end of *link*."""
    # A Ctrl-C is for the daemon, which may still have to bring its devices to rest.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A terminal may stop whoever writes from the background (`stty tostop`).
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    # It has next to nothing to do, but that at once; servos, at 80, still go first.
    set_scheduling(PRIORITY)
    _Stops(socket.socket(fileno=listener), socket.socket(fileno=link)).run()
