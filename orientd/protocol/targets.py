"""Tracking on the wire: targets, and chunks of poses."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import NamedTuple

from orientd.driver import Quaternion, Vector3
from orientd.errors import RequestError
from orientd.floats import rotate_back
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import to_quaternion, to_vector
from orientd.stream.records import CHUNK_POSES, Sample
from orientd.tolerances import NORM_TOLERANCE

TIME_TO_LIVE = 0.5
"""How long a target counts that does not say so itself, s."""

LONGEST_LIFE = 60.0

LONGEST_AHEAD = 10.0
"""How far ahead of its instant a target may come, s."""

LONGEST_CHUNK = 60.0
"""How far ahead of its instant the last pose of a chunk may come, s."""

LONGEST_AGO = 60.0
"""Age from which a stamp is a mistake rather than late, s."""

MOST_METRES = 1000.0
"""Largest component of a position, m."""

MOST_RATE = 1000.0
"""Largest component of an angular velocity, rad/s."""

LEAST_SPACING_NS = 500_000
"""Poses of a chunk that are nearer in time than this are of the same instant."""

_FRAMES = (pb.FRAME_BODY, pb.FRAME_WORLD)

_YEAR_NS = 365 * 86_400 * 1_000_000_000

_UNITS = (("", 1.0), ("nanoseconds", 1e9), ("milliseconds", 1e3), ("microseconds", 1e6))
_UNITS_OF_NANOSECONDS = (("", 1.0), ("seconds", 1e-9), ("milliseconds", 1e-6))
"""Units in which stamps are given by mistake, and how many of them the right unit has."""


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


def stamp_problem(
    time_ns: float,
    now_ns: int,
    *,
    ahead: float,
    ago: float = LONGEST_AGO,
    is_seconds: bool = False,
    clock: str = "the daemon's monotonic clock",
) -> str:
    """Return what is wrong with a stamp, or an empty string.

    Args:
        time_ns: the stamp, ns.
        now_ns: the time now on the clock that it should be of.
        ahead: how far ahead of now it may be, s.
        ago: how long ago it may be, s.
        is_seconds: whether the user gave it in seconds.
        clock: that clock, in words.
    """
    away = (time_ns - now_ns) * 1e-9
    if -ago <= away <= ahead:
        return ""
    given = f"{time_ns * 1e-9:.10g} s" if is_seconds else f"{time_ns:.10g} ns"
    now = f"{now_ns * 1e-9:.10g} s" if is_seconds else f"{now_ns} ns"
    hint = f"give {clock}, now {now}"
    unix_ns = time.time_ns()
    for unit, factor in _UNITS if is_seconds else _UNITS_OF_NANOSECONDS:
        suffix = f" in {unit}" if unit else ""
        if abs(time_ns - factor * unix_ns) < factor * _YEAR_NS:
            return f"{given} is Unix time{suffix}; {hint}"
        if unit and abs(time_ns - factor * now_ns) < 0.01 * factor * now_ns:
            return f"{given} is a time{suffix}; {hint}"
    if away > 0.0:
        return f"expected at most {ahead:g} s ahead, got {away:.6g} s; {hint}"
    return f"expected at most {ago:g} s ago, got {-away:.6g} s; {hint}"


def pose_problem(q: Quaternion, omega: Vector3 | None, position: Vector3 | None) -> str:
    """Return what is wrong with a pose and its angular velocity, or an empty string."""
    w, x, y, z = q
    size = math.sqrt(w * w + x * x + y * y + z * z)
    # Written so that a NaN is a problem.
    if not abs(size - 1.0) <= NORM_TOLERANCE:
        return f"expected a quaternion of norm 1 within {NORM_TOLERANCE:g}, got norm {size:.9g}"
    if position is not None and not _is_within(position, MOST_METRES):
        return f"expected a position within {MOST_METRES:g} m, got {position}"
    if omega is not None and not _is_within(omega, MOST_RATE):
        return f"expected an angular velocity within {MOST_RATE:g} rad/s, got {omega}"
    return ""


def _is_within(vector: Vector3, most: float) -> bool:
    return all(abs(component) <= most for component in vector)


def target_from_message(message: pb.TrackTarget, now_ns: int) -> AimedAt:
    """Return the target of a message that arrived at *now_ns*.

    Raises:
        RequestError: it is none, or it has expired.
    """
    q = to_quaternion(message.orientation)
    omega = position = None
    if message.HasField("angular_velocity"):
        omega = to_vector(message.angular_velocity)
        if message.velocity_frame not in _FRAMES:
            raise RequestError("target.velocity_frame", "expected body or world")
    if message.HasField("position"):
        position = to_vector(message.position)
    for field, step, parts in (
        ("orientation", "give a unit quaternion", (q, None, None)),
        ("position", "give metres", (q, None, position)),
        ("angular_velocity", "give rad/s", (q, omega, None)),
    ):
        problem = pose_problem(*parts)
        if problem:
            raise RequestError(f"target.{field}", f"{problem}; {step}")
    if omega is not None and message.velocity_frame == pb.FRAME_WORLD:
        omega = rotate_back(q, omega)
    life = message.time_to_live or TIME_TO_LIVE
    if not 0.0 < life <= LONGEST_LIFE:
        raise RequestError(
            "target.time_to_live",
            f"expected more than 0 and at most {LONGEST_LIFE:g} s, got {life}",
        )
    time_ns = message.time_ns or now_ns
    problem = stamp_problem(time_ns, now_ns, ahead=LONGEST_AHEAD)
    expires_ns = time_ns + round(life * 1e9)
    if not problem and expires_ns <= now_ns:
        age = (now_ns - time_ns) * 1e-9
        problem = f"stamped {age:.6g} s before it arrived, but it counts for {life:g} s"
        problem += "; give the time at which it is due, or a longer time_to_live"
    if problem:
        raise RequestError("target.time_ns", problem)
    return AimedAt(q, omega, time_ns, expires_ns, position)


class Poses(NamedTuple):
    """The poses of a chunk, checked.

    Attributes:
        samples: times ascending; at least one.
        skipped: how many were none, or for the instant of a later one.
        problem: why the last of those was none; empty if all were poses.
    """

    samples: list[Sample]
    skipped: int
    problem: str


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
    problem = ""
    for k, (time_ns, (w, x, y, z)) in enumerate(zip(message.times_ns, qs, strict=True)):
        position = omega = None
        if positions:
            a, b, c = positions[k]
            position = (a, b, c)
        if omegas:
            a, b, c = omegas[k]
            omega = (a, b, c)
        wrong = pose_problem((w, x, y, z), omega, position)
        if wrong:
            problem = f"poses[{k}]: {wrong}"
            continue
        if omega is not None and is_world:
            omega = rotate_back((w, x, y, z), omega)
        by_time[time_ns] = Sample(time_ns, (w, x, y, z), omega, position)
    samples: list[Sample] = []
    for _, sample in sorted(by_time.items()):
        if samples and sample.time_ns - samples[-1].time_ns < LEAST_SPACING_NS:
            samples.pop()
        samples.append(sample)
    if not samples:
        raise RequestError("chunk", f"none of its {count} poses is one: {problem}")
    if message.observed_ns:
        wrong = stamp_problem(message.observed_ns, now_ns, ahead=LONGEST_AHEAD)
        if wrong:
            raise RequestError("chunk.observed_ns", wrong)
    check_chunk_times("chunk.times_ns", samples[0].time_ns, samples[-1].time_ns, now_ns)
    return Poses(samples, count - len(samples), problem)


def check_chunk_times(
    field: str,
    first_ns: float,
    last_ns: float,
    now_ns: int,
    *,
    is_seconds: bool = False,
    clock: str = "the daemon's monotonic clock",
) -> None:
    """Check the times of the first and last pose of a chunk, for *field*; see `stamp_problem`.

    The first ones may be as old as you like: they only shape the curve through the others.

    Raises:
        RequestError: one is too far ahead, or the last one is so old that it is a mistake.
    """
    for time_ns, ahead in ((max(first_ns, now_ns), LONGEST_AHEAD), (last_ns, LONGEST_CHUNK)):
        problem = stamp_problem(time_ns, now_ns, ahead=ahead, is_seconds=is_seconds, clock=clock)
        if problem:
            raise RequestError(field, problem)


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
