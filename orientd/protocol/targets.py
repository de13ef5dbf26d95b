"""Tracking on the wire: targets, and chunks of poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from orientd.driver import Quaternion, Vector3
from orientd.errors import RequestError
from orientd.floats import rotate_back
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import to_quaternion, to_vector
from orientd.stream import CHUNK_POSES, Sample
from orientd.tolerances import NORM_TOLERANCE

TIME_TO_LIVE = 0.5
"""How long a target counts that does not say so itself, s."""

LONGEST_LIFE = 60.0

LONGEST_AHEAD = 10.0
"""How far ahead of its instant a target may come, s."""

LONGEST_CHUNK = 60.0
"""How far ahead of its instant the last pose of a chunk may come, s."""

MOST_METRES = 1000.0
"""Largest component of a position of a chunk, m."""

MOST_RATE = 1000.0
"""Largest component of an angular velocity of a chunk, rad/s."""

LEAST_SPACING_NS = 500_000
"""Poses of a chunk that are nearer in time than this are of the same instant."""

_FRAMES = (pb.FRAME_BODY, pb.FRAME_WORLD)


class AimedAt(NamedTuple):
    """A target, checked.

    Attributes:
        q: orientation ``(w, x, y, z)``, tool to world.
        omega_body: its angular velocity, rad/s, if that is given.
        time_ns: when, monotonic clock.
        expires_ns: until when it counts.
        position: its position, m, if it has one.
    """

    q: Quaternion
    omega_body: Vector3 | None
    time_ns: int
    expires_ns: int
    position: Vector3 | None


def target_from_message(message: pb.TrackTarget, now_ns: int) -> AimedAt:
    """Return the target of a message that arrived at *now_ns*.

    Raises:
        RequestError: it is none.
    """
    q = to_quaternion(message.orientation)
    size = math.sqrt(sum(x * x for x in q)) if all(map(math.isfinite, q)) else math.nan
    if not abs(size - 1.0) <= NORM_TOLERANCE:
        raise RequestError(
            "target.orientation", f"norm must be 1 within {NORM_TOLERANCE:g}, got {size:.9g}"
        )
    omega = position = None
    if message.HasField("angular_velocity"):
        omega = to_vector(message.angular_velocity)
        if not all(map(math.isfinite, omega)):
            raise RequestError("target.angular_velocity", f"expected finite numbers, got {omega}")
        if message.velocity_frame not in _FRAMES:
            raise RequestError("target.velocity_frame", "expected body or world")
        if message.velocity_frame == pb.FRAME_WORLD:
            omega = rotate_back(q, omega)
    if message.HasField("position"):
        position = to_vector(message.position)
        if not all(map(math.isfinite, position)):
            raise RequestError("target.position", f"expected finite numbers, got {position}")
    life = message.time_to_live or TIME_TO_LIVE
    if not 0.0 < life <= LONGEST_LIFE:
        raise RequestError(
            "target.time_to_live",
            f"expected more than 0 and at most {LONGEST_LIFE:g} s, got {life}",
        )
    time_ns = message.time_ns or now_ns
    ahead = (time_ns - now_ns) * 1e-9
    if ahead > LONGEST_AHEAD:
        raise RequestError(
            "target.time_ns", f"expected at most {LONGEST_AHEAD:g} s ahead, got {ahead:.6g} s"
        )
    return AimedAt(q, omega, time_ns, time_ns + round(life * 1e9), position)


class Poses(NamedTuple):
    """The poses of a chunk, checked.

    Attributes:
        samples: times ascending; at least one.
        skipped: how many were none.
    """

    samples: list[Sample]
    skipped: int


def poses_from_message(message: pb.TrackChunk, now_ns: int) -> Poses:
    """Return the poses of a chunk that arrived at *now_ns*, in order.

    A pose that is not finite, not of unit norm, or out of range is skipped.  Of several poses for
    one instant, the last one counts.

    Raises:
        RequestError: the columns do not fit, the times are out of range, or no pose is left.
    """
    count = len(message.times_ns)
    if not 1 <= count <= CHUNK_POSES:
        raise RequestError("chunk.times_ns", f"expected 1 to {CHUNK_POSES}, got {count}")
    qs = _rows("chunk.orientations", message.orientations, count, 4)
    positions = _rows("chunk.positions", message.positions, count, 3, may_lack=True)
    omegas = _rows("chunk.angular_velocities", message.angular_velocities, count, 3, may_lack=True)
    if omegas and message.velocity_frame not in _FRAMES:
        raise RequestError("chunk.velocity_frame", "expected body or world")
    is_world = message.velocity_frame == pb.FRAME_WORLD
    by_time: dict[int, Sample] = {}
    for k, (time_ns, (w, x, y, z)) in enumerate(zip(message.times_ns, qs, strict=True)):
        size = math.sqrt(w * w + x * x + y * y + z * z)
        # Written so that a NaN is skipped.
        if not abs(size - 1.0) <= NORM_TOLERANCE:
            continue
        position = omega = None
        if positions:
            a, b, c = positions[k]
            if not max(abs(a), abs(b), abs(c)) <= MOST_METRES or a + b + c != a + b + c:
                continue
            position = (a, b, c)
        if omegas:
            a, b, c = omegas[k]
            if not max(abs(a), abs(b), abs(c)) <= MOST_RATE or a + b + c != a + b + c:
                continue
            omega = rotate_back((w, x, y, z), (a, b, c)) if is_world else (a, b, c)
        by_time[time_ns] = Sample(time_ns, (w, x, y, z), omega, position)
    samples: list[Sample] = []
    for _, sample in sorted(by_time.items()):
        if samples and sample.time_ns - samples[-1].time_ns < LEAST_SPACING_NS:
            samples.pop()
        samples.append(sample)
    if not samples:
        raise RequestError("chunk.orientations", "expected unit quaternions, every one is skipped")
    for sample, most in ((samples[0], LONGEST_AHEAD), (samples[-1], LONGEST_CHUNK)):
        ahead = (sample.time_ns - now_ns) * 1e-9
        if ahead > most:
            raise RequestError(
                "chunk.times_ns", f"expected at most {most:g} s ahead, got {ahead:.6g} s"
            )
    return Poses(samples, count - len(samples))


def _rows(
    field: str, column: Sequence[float], count: int, width: int, *, may_lack: bool = False
) -> list[Sequence[float]]:
    if may_lack and not column:
        return []
    if len(column) != count * width:
        raise RequestError(
            field, f"expected {count * width} numbers, {width} a pose, got {len(column)}"
        )
    return [column[k : k + width] for k in range(0, count * width, width)]
