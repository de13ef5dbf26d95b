"""The gateway: the process that speaks Zenoh for one daemon.

It knows nothing of what is carried: calls go to the daemon as the bytes they came in, together with
the caller's name, and the daemon treats them as calls at its control socket.  Stops go the way that
``orientd stop`` goes, to the process that takes stops, whatever the daemon itself is about.
"""

from __future__ import annotations

import itertools
import json
import os
import select
import signal
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from orientd.errors import OrientdError
from orientd.fleet import keys
from orientd.fleet.frames import Header, read_frame, write_frame
from orientd.fleet.session import open_session
from orientd.fleet.start_barrier import StartBarrier
from orientd.rpc import ask_to_stop
from orientd.servo import set_scheduling

if TYPE_CHECKING:
    import zenoh

PRIORITY = 10
"""Of SCHED_FIFO, where the process may have it: below servos and what takes stops."""

MOST_CALLS = 256
"""Calls under way at the same time, of all callers together."""


KEPT = 256
"""Clients that have left whose calls may still be on their way."""


@dataclass
class _Call:
    """A call that the daemon has been handed, or will be.

    Attributes:
        parts: requests that it has not taken yet, of a call with many.
        next_part: number of the next of them.
    """

    query: zenoh.Query
    key: str
    caller: str
    session: str
    id: str
    start: str = ""
    parts: deque[zenoh.Query] = field(default_factory=deque)
    next_part: int = 0


class Gateway:
    """One daemon's place in its cell."""

    def __init__(self, link: socket.socket, incoming: BinaryIO, begin: Header) -> None:
        """Join the cell.

        Args:
            link: to the daemon.
            incoming: what it says.
            begin: what the daemon says first: ``cell``, ``name``, ``socket`` and ``zenoh``, its
                configuration.

        Raises:
            OrientdError: Zenoh is not there, or cannot listen.
        """
        import zenoh

        self._zenoh = zenoh
        self._link, self._incoming, self._sending = link, incoming, threading.Lock()
        self._socket = Path(begin["socket"])
        self._cell, self._name = begin["cell"], begin["name"]
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._calls: dict[int, _Call] = {}
        self._called: dict[tuple[str, str], int] = {}
        self._sessions: set[str] = set()
        self._gone: deque[str] = deque(maxlen=KEPT)
        self._session = session = open_session(begin["zenoh"])
        self._barrier = StartBarrier(self._name, self._say)
        self._state = session.declare_publisher(
            self._key("state"), congestion_control=zenoh.CongestionControl.DROP
        )
        self._events = session.declare_publisher(
            self._key("events"), priority=zenoh.Priority.INTERACTIVE_HIGH
        )
        live = session.liveliness()
        asked = {"rpc/*": self._call, "cancel/*": self._cancel, "stop": self._stop}
        cell = self._cell
        self._declared = [
            self._state.declare_matching_listener(self._look),
            *(
                session.declare_queryable(self._key(f"as/*/{what}"), do)
                for what, do in asked.items()
            ),
            # In Zenoh's own thread: what a thread of ours took would count as the clock's.
            session.declare_queryable(
                self._key("as/*/clock"), zenoh.handlers.Callback(self._tell_time, indirect=False)
            ),
            session.declare_subscriber(keys.of_daemon(cell, "*", "ready/*"), self._hear_ready),
            live.declare_subscriber(keys.all_presences(cell), self._hear_caller, history=True),
            live.declare_subscriber(keys.of_daemon(cell, "*", "alive"), self._miss_daemon),
            live.declare_token(self._key("alive")),
        ]
        self._send({"joined": str(session.zid())})

    def run(self) -> None:
        """Carry what the daemon says until it is gone."""
        while (frame := read_frame(self._incoming)) is not None:
            header, body = frame
            if "state" in header:
                self._state.put(body, attachment=json.dumps(header).encode())
            elif "events" in header:
                self._events.put(body, attachment=json.dumps(header).encode())
            elif "answer" in header:
                self._answer(header["answer"], body)
            elif "taken" in header:
                self._acknowledge(header["taken"])
            elif "end" in header:
                self._end(header["end"], body)
        self._session.close()  # type: ignore[no-untyped-call] # Zenoh's stub

    # Calls

    def _call(self, query: zenoh.Query) -> None:
        key, said = str(query.key_expr), _said(query)
        caller = keys.caller_of(key)
        if caller is None or "*" in key:
            return
        call = _Call(query, key, caller, str(said.get("session")), str(said.get("id")))
        body = query.payload.to_bytes() if query.payload is not None else b""
        if "part" in said:
            self._take_part(query, (caller, call.id), said, body)
            return
        number = next(self._numbers)
        with self._lock:
            if call.session in self._gone:
                return
            is_room = len(self._calls) < MOST_CALLS
            if is_room:
                self._calls[number] = call
                self._called[caller, call.id] = number
        if not is_room:
            text = f"at most {MOST_CALLS} calls at the same time over the fleet"
            query.reply_err(json.dumps({"busy": text}).encode())
            query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub
            return
        header = {"call": number, "method": keys.last_of(key), "caller": caller}
        if said.get("parts"):
            header["parts"] = True
        start = said.get("start")
        if not isinstance(start, dict):
            self._send(header, body)
            return
        call.start = str(start["id"])
        self._barrier.join(
            call.start,
            frozenset(map(str, start["among"])),
            parts=int(start["parts"]),
            start_ns=int(start["start_ns"]),
            until_ns=int(start["until_ns"]),
            begin=lambda: self._begin(call, header, body),
            refuse=lambda why: self._refuse(number, why),
            drop=lambda: self._send({"cancel": number}),
        )

    def _answer(self, number: int, body: bytes) -> None:
        call = self._calls.get(number)
        if call is not None:
            call.query.reply(call.key, body)

    def _take_part(
        self, query: zenoh.Query, called: tuple[str, str], said: Header, body: bytes
    ) -> None:
        """Hand on one request of a call with many, which the same caller has begun."""
        with self._lock:
            number = self._called.get(called)
            call = None if number is None else self._calls[number]
            if call is not None:
                is_next = said["part"] == call.next_part
                call.next_part += 1
                call.parts.append(query)
        if call is None:
            query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub
        elif not is_next:
            # What comes in another order than it was sent in is no message.
            self._send({"cancel": number})
        else:
            self._send({"part": number, "is_last": bool(said.get("last"))}, body)

    def _acknowledge(self, number: int) -> None:
        call = self._calls.get(number)
        if call is not None and call.parts:
            call.parts.popleft().drop()  # type: ignore[no-untyped-call] # Zenoh's stub

    def _close(self, number: int, error: bytes) -> _Call | None:
        """End a call, with *error* if there is one; return it, unless it has ended already."""
        with self._lock:
            call = self._calls.pop(number, None)
            if call is None:
                return None
            self._called.pop((call.caller, call.id), None)
        while call.parts:
            call.parts.popleft().drop()  # type: ignore[no-untyped-call] # Zenoh's stub
        if error:
            call.query.reply_err(error)
        call.query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub
        return call

    def _end(self, number: int, body: bytes) -> None:
        """End a call; *body* is what went wrong, a ``google.rpc.Status``, or nothing."""
        call = self._close(number, body)
        if call is not None and body and call.start:
            self._barrier.fail(call.start, "another motion of this daemon could not begin")

    def _refuse(self, number: int, why: str) -> None:
        self._close(number, json.dumps({"refused": why}).encode())

    def _cancel(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        self._cancel_all(caller=keys.caller_of(key), id=keys.last_of(key))
        query.reply(key, b"")

    def _cancel_all(self, **of: str | None) -> None:
        with self._lock:
            calls = [
                (number, call)
                for number, call in self._calls.items()
                if all(getattr(call, name) == value for name, value in of.items())
            ]
        for number, call in calls:
            if call.start:
                self._barrier.fail(call.start, "its caller has gone away")
            self._send({"cancel": number})

    def _hear_caller(self, sample: zenoh.Sample) -> None:
        session = keys.last_of(str(sample.key_expr))
        if sample.kind == self._zenoh.SampleKind.PUT:
            with self._lock:
                self._sessions.add(session)
            return
        with self._lock:
            self._sessions.discard(session)
            self._gone.append(session)
        self._cancel_all(session=session)

    def _begin(self, call: _Call, header: Header, body: bytes) -> None:
        """Hand the motion of a start on to the daemon, if whoever asked is still there."""
        # What they asked and that they have left come by different threads.
        with self._lock:
            is_there = call.session in self._sessions
        if is_there:
            self._send(header, body)
        else:
            self._barrier.fail(call.start, "its caller has gone away")
            self._refuse(header["call"], "its caller has gone away")

    # Starts

    def _say(self, start: str, what: bytes) -> None:
        self._session.put(
            self._key(f"ready/{start}"),
            what,
            priority=self._zenoh.Priority.REAL_TIME,
            express=True,
        )

    def _hear_ready(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        self._barrier.hear(keys.last_of(key), keys.daemon_of(key), sample.payload.to_bytes())

    def _miss_daemon(self, sample: zenoh.Sample) -> None:
        if sample.kind == self._zenoh.SampleKind.DELETE:
            self._barrier.lose(keys.daemon_of(str(sample.key_expr)))

    # What is answered here

    def _stop(self, query: zenoh.Query) -> None:
        """Stop every device, or halt them, by the way of stops; the answer is what it met."""
        caller = keys.caller_of(str(query.key_expr))
        if caller is None:
            return
        kind = "halt" if query.parameters.get("kind") == "halt" else "stop"
        try:
            told: dict[str, Any] = {"devices": ask_to_stop(self._socket, kind)}
            if told["devices"] is None:
                told = {"error": "nothing takes stops there"}
        except OrientdError as error:
            told = {"error": str(error)}
        told["time_ns"] = time.monotonic_ns()
        key = keys.as_caller(self._cell, self._name, caller, "stop")
        query.reply(key, json.dumps(told).encode(), express=True)
        query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub
        self._send({"stopped": kind, "caller": caller, **told})

    def _tell_time(self, query: zenoh.Query) -> None:
        now = time.monotonic_ns()
        caller = keys.caller_of(str(query.key_expr))
        if caller is not None:
            key = keys.as_caller(self._cell, self._name, caller, "clock")
            query.reply(key, now.to_bytes(8, "little"), express=True)
        query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub

    # The daemon

    def _look(self, status: zenoh.MatchingStatus) -> None:
        self._send({"watched": bool(status.matching)})

    def _key(self, what: str) -> str:
        return keys.of_daemon(self._cell, self._name, what)

    def _send(self, header: Header, body: bytes = b"") -> None:
        with self._sending:
            try:
                self._link.sendall(write_frame(header, body))
            except OSError:
                os._exit(0)  # the daemon is gone, and with it everything to be carried


def _said(query: zenoh.Query) -> Header:
    if query.attachment is None:
        return {}
    try:
        said = json.loads(query.attachment.to_bytes())
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}


def _end_with(connection: socket.socket) -> None:
    """End this process once the daemon is gone, whatever it waits for: a router, for example."""
    watched = select.poll()
    watched.register(connection, select.POLLHUP)
    watched.poll()
    os._exit(0)


def main(link: int) -> None:
    """Be the gateway of the daemon at the other end of *link*."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A terminal may stop whoever writes from the background (`stty tostop`).
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    # A stop is not to wait for whatever else the machine does; Zenoh's threads have it from here.
    set_scheduling(PRIORITY)
    connection = socket.socket(fileno=link)
    threading.Thread(target=_end_with, args=(connection,), name="end", daemon=True).start()
    incoming = connection.makefile("rb")
    first = read_frame(incoming)
    if first is None:
        return
    try:
        gateway = Gateway(connection, incoming, first[0])
    except OrientdError as error:
        connection.sendall(write_frame({"failed": str(error)}))
        return
    gateway.run()
