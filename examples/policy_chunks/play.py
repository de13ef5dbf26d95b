"""Play the chunks of a simulated policy with orientd, and compare two common ways to join them.

This needs a daemon: `orientd run` in another terminal.  It moves the device, prints figures of all
three ways, and draws policy-chunks.png if Matplotlib is installed.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from interpolated import Chunk, slerped, straight
from played import Played, draw_played

import orientd
from orientd import PlayTiming, Robot, plots, rotation
from orientd.rotation import Quaternion
from orientd.stream import Cycle, ServoState

SECONDS, RATE, POSES = 4.0, 30.0, 16
INFERENCE = 0.15
"""Inference time of the policy for a chunk, s."""

LOSS = 0.05
"""Share of lost poses."""

NOISE = 2e-3
"""Disagreement of two chunks, rad."""

# Two rotation vectors of a real policy: neighbours in time, 47 degrees apart, but components of
# opposite sign, since a turn by more than half a turn is the other way round.
FROM = (1.4108558893203735, -0.14490126073360443, 2.2968666553497314)
TO = (-1.9869475665660719, -0.20934335242279448, -2.127417674763405)


def chunks(seed: int = 1) -> Iterator[Chunk]:
    """Yield the chunks of a policy that swings to and fro between two orientations."""
    rng, start = random.Random(seed), rotation.exp(FROM)
    way = rotation.log(rotation.between(start, rotation.exp(TO)))
    for observed in np.arange(0.0, SECONDS, INFERENCE):
        kept = [k for k in range(POSES) if rng.random() > LOSS]
        times = observed + np.array(kept) / RATE
        shares = 0.5 - 0.5 * np.cos(np.pi * times)
        noise = rotation.exp([rng.gauss(0.0, NOISE) for _ in range(3)])
        q = rotation.multiply(rotation.multiply(start, rotation.exp(shares[:, None] * way)), noise)
        yield Chunk(observed + INFERENCE, times, rotation.log(q))


def play_chunks(robot: Robot, period: float) -> tuple[Played, PlayTiming]:
    """Play the chunks on the device; return the setpoints that it got, and how it went."""
    cycles: list[Cycle] = []
    is_over = threading.Event()

    def watch() -> None:
        for batch in robot.watch():
            cycles.extend(batch)
            if is_over.is_set():
                return

    robot.move([{"rotation_vector": FROM}], approach=True).wait()
    watcher = threading.Thread(target=watch)
    watcher.start()
    with robot.play() as play:
        begin = time.monotonic()
        for chunk in chunks():
            time.sleep(max(begin + chunk.arrives - time.monotonic(), 0.0))
            poses = Quaternion.from_array(rotation.exp(chunk.vectors), order="wxyz")
            play.chunk(poses if isinstance(poses, list) else [poses], times=chunk.times + begin)
    is_over.set()
    watcher.join()
    sent = [cycle.q for cycle in cycles if cycle.state is ServoState.TRACKING]
    return Played("orientd", 0.0, period, np.array(sent)), play.timing()


def main() -> None:
    """Play the chunks in three ways, print the figures and draw them."""
    with orientd.connect() as robot:
        (device,) = robot.devices()
        period = 1.0 / device.rate_hz
        smooth, timing = play_chunks(robot, period)
    joined = (straight(chunks(), period, SECONDS), slerped(chunks(), period, SECONDS), smooth)
    limit = device.limits.acceleration
    print(f"{'':18}turned, deg  step, deg  acceleration, rad/s^2  cycles above limit")
    for one in joined:
        above = int(np.sum(one.acceleration > 1.001 * limit))
        print(
            f"{one.name:18}{np.degrees(one.turned[-1]):11.0f}{np.degrees(one.steps.max()):11.2f}"
            f"{one.acceleration.max():23.3g}{above:20}"
        )
    print(f"{'limit':18}{limit:45.3g}")
    print(f"{timing.chunks} chunks, {timing.stale} poses late")
    if plots.is_available():
        arrivals = [chunk.arrives for chunk in chunks()]
        title = "The chunks of a policy, as sent"
        draw_played(Path("policy-chunks.png"), joined, limit, arrivals, title=title)


if __name__ == "__main__":
    main()
