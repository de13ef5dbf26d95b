"""Motions and commands that run when a test does harm."""

from __future__ import annotations

import contextlib
import math
import queue
import random
import threading
import time

import grpc
from harness import DEVICE, nudge, spin
from stage import Stage

from orientd import rotation
from orientd.protocol import control_pb2 as pb


class Scene:
    """Activity on the device; a thread continues it until :meth:`end`."""

    def __init__(self, stage: Stage, generator: random.Random) -> None:
        self.stage = stage
        self.random = generator
        self.ending = threading.Event()
        self.begin()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def begin(self) -> None:
        """Begin a motion."""
        self.stage.begin(spin(4.0))

    def go_on(self) -> None:
        """Send the commands of the scene until its end."""

    def end(self) -> None:
        """End the activity."""
        self.ending.set()
        self._thread.join(40.0)
        assert not self._thread.is_alive(), "a call hangs"

    def _run(self) -> None:
        # After the harm, calls may fail.  The stage measures their duration.
        with contextlib.suppress(grpc.RpcError, StopIteration):
            self.go_on()


class Move(Scene):
    """One motion runs."""


class Retarget(Scene):
    """New motions replace the running one, again and again."""

    def go_on(self) -> None:
        while not self.ending.wait(self.random.uniform(0.0, 0.15)):
            self.stage.begin(nudge(self.random.uniform(-0.8, 0.8)))


class Queue(Scene):
    """Queued motions follow, some of them without a stop."""

    def begin(self) -> None:
        self.stage.begin(nudge(0.5))

    def go_on(self) -> None:
        while not self.ending.wait(self.random.uniform(0.05, 0.3)):
            if len(self.stage.streams) < 6:
                blend = self.random.choice((0.0, 0.05))
                motion = nudge(self.random.uniform(-0.6, 0.6))
                self.stage.begin(motion, queue=True, blend_tolerance=blend)


class Track(Scene):
    """The device tracks a moving target."""

    def begin(self) -> None:
        self.outgoing: queue.SimpleQueue = queue.SimpleQueue()
        start = pb.TrackStart(lease_token=self.stage.daemon.token, device=DEVICE)
        self.outgoing.put(pb.TrackRequest(start=start))
        stream = self.stage.daemon.stub.Track(iter(self.outgoing.get, None), timeout=60)
        self.stage.calls.measure("Track", lambda: next(stream))
        self.stage.streams.append(stream)

    def go_on(self) -> None:
        begun = time.monotonic()
        while not self.ending.wait(0.01):
            angle = 0.5 * math.sin(1.5 * (time.monotonic() - begun))
            w, x, y, z = rotation.exp([0.2 * angle, 0.0, angle]).tolist()
            target = pb.TrackTarget(orientation=pb.Quaternion(w=w, x=x, y=y, z=z))
            self.outgoing.put(pb.TrackRequest(target=target))

    def end(self) -> None:
        super().end()
        self.outgoing.put(None)


class Pause(Scene):
    """The motion pauses and resumes."""

    def go_on(self) -> None:
        while not self.ending.wait(self.random.uniform(0.02, 0.4)):
            with contextlib.suppress(grpc.RpcError):
                self.stage.command(self.random.choice(("Pause", "Resume")))


class Slow(Scene):
    """The speed changes all the time."""

    def go_on(self) -> None:
        while not self.ending.wait(self.random.uniform(0.02, 0.3)):
            self.stage.command("SetSpeed", speed=self.random.uniform(0.05, 1.0))


class Stop(Scene):
    """The motion comes to rest."""

    def go_on(self) -> None:
        self.ending.wait(self.random.uniform(0.1, 1.4))
        self.stage.command(self.random.choice(("Stop", "Halt")))


SCENES = (Move, Retarget, Queue, Track, Pause, Slow, Stop)
LATEST = 1.5
"""The latest moment for harm, s after the beginning."""


@contextlib.contextmanager
def under_way(stage: Stage, number: int, generator: random.Random):
    """Run one of the scenes, and yield at a random moment of it."""
    kind = SCENES[number % len(SCENES)]
    scene = kind(stage, generator)
    try:
        time.sleep(generator.uniform(0.0, LATEST))
        yield scene
    finally:
        scene.end()
