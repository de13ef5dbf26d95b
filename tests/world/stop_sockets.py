"""The stop sockets of servos in the world: real datagrams, for whose answers tasks wait.

A datagram on one machine is there as soon as it is sent, so nothing depends on real time.
"""

from __future__ import annotations

import _socket
import os
import time
from types import SimpleNamespace

from orientd import first_stop
from orientd.servo import process as servo_process
from orientd.servo.stop_socket import StopSocket

_LOOK = 0.0005
"""Interval between two looks for an answer, s."""

_REAL_PID = os.getpid


class VirtualStopSocket(StopSocket):
    """The stop socket of a servo, which closes when the process is killed."""

    world = None

    def __init__(self, path, daemon_pid, admitted):
        del daemon_pid  # the kernel knows this process alone
        super().__init__(path, _REAL_PID(), admitted)
        self.world.present().at_end(self.close)


class _Asking(_socket.socket):
    """The socket of a sender, which waits in virtual time."""

    seconds = 0.0

    def settimeout(self, seconds):
        self.seconds = seconds
        super().settimeout(0.0)

    def recvmsg(self, *sizes):
        ends = time.monotonic() + self.seconds
        while True:
            try:
                return super().recvmsg(*sizes)
            except BlockingIOError:
                if time.monotonic() >= ends:
                    raise TimeoutError from None
                time.sleep(min(_LOOK, ends - time.monotonic()))


def of_stop_sockets(world):
    """Return what stops find in a world: owners, names and values to replace."""
    sockets = SimpleNamespace(**{**vars(_socket), "socket": _Asking})
    return [
        (VirtualStopSocket, "world", world),
        (servo_process, "StopSocket", VirtualStopSocket),
        (first_stop, "_socket", sockets),
    ]
