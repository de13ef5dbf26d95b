"""The gateway: the process that speaks Zenoh for one daemon.

It declares the daemon's presence, publishes its state, tells its clock, and stops its devices as
``orientd stop`` does: directly to the servos, even while the daemon hangs.  The daemon is
at the other end of a socket of packets.  Its first packet is the configuration, JSON; each one
after it is a state: the time it was taken, 8 bytes, and a ``GetStateResponse``.  The gateway
answers in JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orientd.client import ask_to_stop
from orientd.errors import OrientdError
from orientd.fleet.keys import PACKET_BYTES, TIME_BYTES, key_of, name_of
from orientd.fleet.session import open_session
from orientd.servo import set_scheduling

if TYPE_CHECKING:
    import zenoh

PRIORITY = 10
"""Of SCHED_FIFO, where the process may have it: below servos."""


class Gateway:
    """One daemon's place in its cell."""

    def __init__(self, link: socket.socket, begin: dict[str, Any]) -> None:
        """Join the cell.

        Args:
            link: to the daemon.
            begin: its first packet: ``cell``, ``name``, ``socket``, ``address`` and ``zenoh``.

        Raises:
            OrientdError: Zenoh is not installed, or cannot listen.
        """
        self._link = link
        self._socket = Path(begin["socket"])
        self._session = session = open_session(begin["zenoh"])
        import zenoh

        def of(what: str, name: str = "") -> str:
            return key_of(begin["cell"], begin["name"], what, name)

        self._of = of
        self._state = session.declare_publisher(
            of("state"), congestion_control=zenoh.CongestionControl.DROP
        )
        self._declared = [
            self._state.declare_matching_listener(self._note_watchers),
            session.declare_queryable(of("stop", "*"), self._stop),
            # In Zenoh's own thread: a thread of ours would add its delay to the clock's.
            session.declare_queryable(
                of("clock"), zenoh.handlers.Callback(self._tell_time, indirect=False)
            ),
            session.liveliness().declare_token(of("alive", begin["address"])),
        ]
        self._send({"joined": str(session.zid())})

    def run(self) -> None:
        """Publish the daemon's states until the daemon is gone."""
        while packet := self._link.recv(PACKET_BYTES):
            self._state.put(packet[TIME_BYTES:], attachment=packet[:TIME_BYTES])
        self._session.close()  # type: ignore[no-untyped-call] # Zenoh's stub

    def _stop(self, query: zenoh.Query) -> None:
        """Stop every device, or halt them; the answer says what each was doing."""
        caller = name_of(str(query.key_expr))
        kind = "halt" if query.parameters.get("kind") == "halt" else "stop"
        try:
            told: dict[str, Any] = {"devices": ask_to_stop(self._socket, kind)}
            if told["devices"] is None:
                told = {"error": "no servo takes stops there"}
        except OrientdError as error:
            told = {"error": str(error)}
        told["time_ns"] = time.monotonic_ns()
        query.reply(self._of("stop", caller), json.dumps(told).encode(), express=True)
        query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub
        # A daemon that hangs must not delay the next stop.
        self._send({"stopped": kind, "caller": caller, **told}, socket.MSG_DONTWAIT)

    def _tell_time(self, query: zenoh.Query) -> None:
        now = time.monotonic_ns()
        query.reply(self._of("clock"), now.to_bytes(TIME_BYTES, "little"), express=True)
        query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub

    def _note_watchers(self, status: zenoh.MatchingStatus) -> None:
        self._send({"watched": bool(status.matching)})

    def _send(self, told: dict[str, Any], flags: int = 0) -> None:
        with contextlib.suppress(OSError):  # the daemon is gone, or has too much to read
            self._link.send(json.dumps(told).encode(), flags)


def _end_with(link: socket.socket) -> None:
    """End this process once the daemon is gone, even while Zenoh still waits for a router."""
    watched = select.poll()
    watched.register(link, select.POLLHUP)
    watched.poll()
    os._exit(0)


def main(descriptor: int) -> None:
    """Run the gateway of the daemon at the other end of a socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A terminal may stop a background process that writes to it (`stty tostop`).
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    # A stop must not wait for other programs; Zenoh's threads inherit this.
    set_scheduling(PRIORITY)
    link = socket.socket(fileno=descriptor)
    threading.Thread(target=_end_with, args=(link,), name="end", daemon=True).start()
    first = link.recv(PACKET_BYTES)
    if not first:
        return
    try:
        gateway = Gateway(link, json.loads(first))
    except OrientdError as error:
        link.send(json.dumps({"failed": str(error)}).encode())
        return
    gateway.run()


if __name__ == "__main__":
    main(int(sys.argv[1]))
