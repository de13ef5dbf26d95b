"""Clients that keep a daemon busy: four watchers, and one that plans motions without pause.

Run as ``python tests/bench/busy_clients.py SOCKET DEVICE`` until it is killed.
"""

from __future__ import annotations

import math
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

from motions import motion_of

from orientd.client.channel import Way
from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

WATCHERS = 4
KEYFRAMES = 200
STEP = 0.1
"""Time between two keyframes, s."""


def motion(count: int = KEYFRAMES) -> bytes:
    """Return a timed motion of *count* keyframes, :data:`STEP` apart."""
    keyframes = []
    for k in range(count):
        t = STEP * k
        tilt, turn = 0.2 * math.sin(0.9 * t), 0.3 * (1.0 - math.cos(0.5 * t))
        vector = [tilt, 0.1 * math.sin(0.4 * t), turn]
        keyframes.append({"time": t, "rotation_vector": vector})
    return motion_of(*keyframes, approach=True)


def watch(stub: SimpleNamespace, device: str) -> None:
    """Read every cycle of *device* as it comes."""
    for _ in stub.WatchState(pb.WatchStateRequest(device=device, rate_hz=20.0)):
        pass


def main(socket: str, device: str) -> None:
    """Keep the daemon at *socket* busy until this process is killed."""
    channel = Way(Path(socket)).open()
    stub = control_stub(channel)
    for _ in range(WATCHERS):
        threading.Thread(target=watch, args=(stub, device), daemon=True).start()
    request = pb.PlanRequest(device=device, motion=motion())
    while True:
        stub.Plan(request)


if __name__ == "__main__":
    main(*sys.argv[1:])
