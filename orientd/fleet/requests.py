"""The requests of a call that has many: sent as they come, no more than the other end takes.

Each is a query of its own, which is answered once the daemon has taken it: so a caller that is
faster than the daemon waits, as it would on the control socket.
"""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable, Iterable
from typing import Any

_log = logging.getLogger(__name__)

MOST_PARTS, MOST_BYTES = 64, 1024 * 1024
"""Requests, and bytes of them, that are under way at the same time: 50 ms of targets at 1 kHz."""

Send = Callable[[dict[str, Any], bytes, Callable[[], object]], object]
"""Sends what is said of a request and the request; told a function to call once it is taken."""


class RequestStream:
    """Sends the requests of one call from a thread of its own."""

    def __init__(
        self, requests: Iterable[bytes], send: Send, give_up: Callable[[], object]
    ) -> None:
        """Begin.

        Args:
            requests: as serialised; the thread waits for each.
            send: sends one.
            give_up: called where making or sending one has failed.
        """
        self._requests, self._send, self._give_up = requests, send, give_up
        self._room = threading.Condition()
        self._parts = self._bytes = 0
        self._has_ended = False
        threading.Thread(target=self._run, name="orientd fleet requests", daemon=True).start()

    def end(self) -> None:
        """Send no more."""
        with self._room:
            self._has_ended = True
            self._room.notify_all()

    def _run(self) -> None:
        number = 0
        try:
            for body in self._requests:
                if not self._wait_for(len(body)):
                    return
                self._send({"part": number}, body, functools.partial(self._take_back, len(body)))
                number += 1
            if not self._has_ended:
                self._send({"part": number, "last": True}, b"", lambda: None)
        except Exception:  # noqa: BLE001 - of whoever makes them
            # As gRPC: whoever waits for the answers is told that the call has ended.
            if not self._has_ended:
                _log.exception("fleet: the requests of a call")
            self._give_up()

    def _wait_for(self, size: int) -> bool:
        """Wait until there is room for so many bytes; return whether the call still goes on."""
        with self._room:
            self._room.wait_for(lambda: self._has_ended or self._has_room(size))
            self._parts += 1
            self._bytes += size
            return not self._has_ended

    def _has_room(self, size: int) -> bool:
        is_little = self._parts < MOST_PARTS and self._bytes + size <= MOST_BYTES
        return not self._parts or is_little

    def _take_back(self, size: int) -> None:
        with self._room:
            self._parts -= 1
            self._bytes -= size
            self._room.notify_all()
