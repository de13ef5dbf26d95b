"""Chunks of poses for a tracker in virtual time."""

from tracking_world import NS, World

from orientd.driver import ZERO
from orientd.servo.tracking.chunks import Chunk, smoothed
from orientd.servo.tracking.preview import Motion
from orientd.stream.records import Sample


class ChunkWorld(World):
    """A world that plays chunks of orientations."""

    def chunk(self, samples):
        """Hand over (time_ns, q) or (time_ns, q, omega) at the next cycle; return the answer."""
        knots = smoothed([Sample(*sample) for sample in samples], self.limits).knots
        guard = self.guard
        sent = Motion(guard.q, guard.omega, guard.alpha, ZERO, ZERO, ZERO)
        return self.tracker.take_chunk(Chunk(knots, has_positions=False), sent, self.now_ns)

    @property
    def report(self):
        """How the chunks are followed."""
        return self.tracker.guidance.statistics.report

    def poses(self, begin_ns, count, hz, motion):
        """Return *count* samples of *motion*, a function of seconds since the world began."""
        stamps = [begin_ns + round(k / hz * NS) for k in range(count)]
        return [(stamp, motion((stamp - NS) / NS)) for stamp in stamps]
