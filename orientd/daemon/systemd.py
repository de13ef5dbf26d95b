"""Report the daemon's state to systemd, and feed its watchdog while the servos make progress.

The daemon does so if systemd asks for it: sd_notify(3), sd_watchdog_enabled(3).  A thread watches
the cycles that the servos publish.  If a servo process runs but its cycles stop, the watchdog is
not fed.  A servo that has ended in a fault does not count: it waits for a reset, and a restart of
the daemon would not help.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from orientd.daemon.device import Device

_log = logging.getLogger(__name__)

FEEDS = 4
"""Messages to the watchdog within its interval."""


def notify(state: str) -> None:
    """Send *state*, for example ``READY=1``, to ``$NOTIFY_SOCKET``; nothing if that is not set."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    # The daemon runs even if the service manager that started it is gone.
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.connect(address)
        sender.sendall(state.encode())


def watchdog_seconds() -> float | None:
    """Return systemd's watchdog interval, s; ``None`` if it does not watch this process."""
    wanted, pid = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", "")
    if not wanted.isdigit() or pid not in ("", str(os.getpid())):
        return None
    return int(wanted) * 1e-6 or None


class Watchdog:
    """Tell systemd that the servos make progress, or nothing."""

    def __init__(self, devices: Mapping[str, Device]) -> None:
        """Look at *devices*, once :meth:`start` is called."""
        self._devices = devices
        self._cycles: dict[str, tuple[int, int]] = {}
        self._done = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin, if systemd has a watchdog."""
        seconds = watchdog_seconds()
        if seconds is not None:
            self._thread = threading.Thread(
                target=self._feed, args=(seconds / FEEDS,), name="watchdog", daemon=True
            )
            self._thread.start()

    def close(self) -> None:
        """Feed it no more."""
        self._done.set()
        if self._thread is not None:
            self._thread.join()

    def stuck(self) -> list[str]:
        """Return the devices whose servo runs and has done no cycle since the last call."""
        found = []
        for name, device in self._devices.items():
            now = device.snapshot()
            if now.servo_pid is None or now.cycle is None:
                self._cycles.pop(name, None)
                continue
            present = (now.servo_pid, now.cycle.index)
            if self._cycles.get(name) == present:
                found.append(name)
            self._cycles[name] = present
        return found

    def _feed(self, interval: float) -> None:
        while not self._done.wait(interval):
            stuck = self.stuck()
            if stuck:
                _log.error("watchdog: no cycle of %s for %.1f s", ", ".join(stuck), interval)
            else:
                notify("WATCHDOG=1")
