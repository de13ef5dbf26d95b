"""Many who plan large files, without a lease, until their standard input is closed.

``python crowd.py SOCKET DEVICE CLIENTS KEYFRAMES AT_ONCE``: so many clients plan one file after the
other, one more plans files twice as large, and another sends so many at once.  At the end it prints
how many calls ended with which status, as JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from collections import Counter

import grpc
import numpy as np
from motions import motion_of, through

from orientd.protocol import control_pb2 as pb
from orientd.rotation import exp

PLAN = "/orientd.v1.Control/Plan"
STEP = 0.004
"""s from keyframe to keyframe of a large file."""


def large_motion(keyframes: int, **more) -> dict[str, bytes]:
    """Return the fields of a timed wandering that grows from rest and falls back to it."""
    times = STEP * np.arange(keyframes)
    ramp = np.clip(np.minimum(times, times[-1] - times) / min(2.0, 0.5 * times[-1]), 0.0, 1.0)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    vectors = np.stack(
        [0.3 * np.sin(0.8 * times), 0.2 * np.sin(1.1 * times), 0.4 * np.sin(0.3 * times)]
    )
    keys = exp((ramp * vectors).T)
    columns = pb.KeyframeColumns(quaternions=keys.ravel().tolist(), times=times.tolist())
    motion = motion_of(approach=True, **more)
    return {"motion": motion, "columns": columns.SerializeToString()}


def endless_motion(keyframes: int = 6000) -> bytes:
    """Return a motion that takes minutes to plan in little memory and can be cancelled any time.

    The search for the curve of least acceleration takes many steps, each over all keyframes.
    """
    numbers = 0.7 * np.arange(keyframes)
    vectors = np.stack([np.sin(numbers), np.cos(1.3 * numbers), np.sin(0.4 * numbers)], axis=1)
    return through(vectors.tolist(), method="min_acceleration", approach=True)


def raw_channel(socket: str) -> grpc.Channel:
    """Return a connection of its own."""
    return grpc.insecure_channel(
        f"unix:{socket}",
        options=[("grpc.use_local_subchannel_pool", 1), ("grpc.max_send_message_length", -1)],
    )


def main(socket: str, device: str, clients: int, keyframes: int, at_once: int) -> None:
    """Plan until standard input is closed."""
    met: Counter[str] = Counter()
    large, largest = (
        pb.PlanRequest(device=device, **large_motion(n)).SerializeToString()
        for n in (keyframes, 2 * keyframes)
    )

    def keep_planning(request: bytes, together: int) -> None:
        # Bytes as they are: what a client does to make them is not what is measured.
        plan = raw_channel(socket).unary_unary(PLAN)
        while True:
            for call in [plan.future(request) for _ in range(together)]:
                code = call.code()  # waits for its end
                met[code.name] += 1

    jobs = [(large, 1)] * clients + [(largest, 1), (large, at_once)]
    for job in jobs:
        threading.Thread(target=keep_planning, args=job, daemon=True).start()
    print("sending", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        sys.stdin.read()
    print(json.dumps(met), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *map(int, sys.argv[3:]))
