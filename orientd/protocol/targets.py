"""Tracking on the wire: targets, and how the following goes."""

from __future__ import annotations

import math
from typing import NamedTuple

from orientd.driver import Quaternion, Vector3
from orientd.errors import RequestError
from orientd.floats import rotate_back
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import to_quaternion, to_vector
from orientd.tolerances import NORM_TOLERANCE

TIME_TO_LIVE = 0.5
"""How long a target counts that does not say so itself, s."""

LONGEST_LIFE = 60.0

LONGEST_AHEAD = 10.0
"""How far ahead of its instant a target may come, s."""

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
