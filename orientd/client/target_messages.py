"""Targets as users write them in Python, converted to messages."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Literal, get_args

from orientd.driver import Quaternion as Orientation
from orientd.driver import Vector3
from orientd.errors import RequestError
from orientd.model.keyframes import keyframe_mapping
from orientd.model.orientation import FORMS
from orientd.model.plain import joined, to_plain
from orientd.model.reading import read_keyframe
from orientd.protocol import control_pb2 as pb
from orientd.protocol.targets import LONGEST_AGO, LONGEST_AHEAD, LONGEST_LIFE, stamp_problem
from orientd.protocol.values import quaternion, vector
from orientd.rotation import Quaternion
from orientd.spelling import did_you_mean

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Frame = Literal["body", "world"]

CLOCK = "time.monotonic() of this machine"
CLOCK_NS = "time.monotonic_ns() of this machine"
"""The clock of stamps, for messages."""

TARGET_KEYS = ("angular_velocity", "velocity_frame", "time_ns", "time_to_live", "position")
"""Keys of a target in addition to its orientation."""


def target_message(
    target: object,
    *,
    angular_velocity: ArrayLike | None = None,
    velocity_frame: Frame = "body",
    time_ns: int = 0,
    time_to_live: float = 0.0,
    position: ArrayLike | None = None,
) -> pb.TrackTarget:
    """Return a target as a message; see :meth:`Tracking.aim`.

    Raises:
        RequestError: the target is malformed.
    """
    is_world = is_in_world(velocity_frame, "target.velocity_frame")
    check_stamp("target.time_ns", time_ns, time.monotonic_ns(), ahead=LONGEST_AHEAD)
    check_life("target.time_to_live", time_to_live, least=0.0)
    message = pb.TrackTarget(time_ns=time_ns, time_to_live=time_to_live)
    message.orientation.CopyFrom(quaternion(orientation_of(target)))
    if angular_velocity is not None:
        message.angular_velocity.CopyFrom(
            vector(vector_of(angular_velocity, "target.angular_velocity"))
        )
        message.velocity_frame = pb.FRAME_WORLD if is_world else pb.FRAME_BODY
    if position is not None:
        message.position.CopyFrom(vector(vector_of(position, "target.position")))
    return message


def check_stamp(
    place: str, time_ns: object, now_ns: int, *, ahead: float, ago: float = LONGEST_AGO
) -> None:
    """Check the time of a sample or target, which may be 0; *place* is its name in messages.

    Args:
        place: its name in messages.
        time_ns: by this machine's monotonic clock, ns.
        now_ns: the time now, by the same clock.
        ahead: how far ahead of that it may be, s.
        ago: how long before that it may be, s.

    Raises:
        RequestError: it is no whole number, of another clock, or too far ahead or ago.
    """
    if isinstance(time_ns, bool) or not isinstance(time_ns, int):
        problem = f"expected a whole number of nanoseconds, got {time_ns!r}; give {CLOCK_NS}"
        raise RequestError(place, problem)
    if not time_ns:
        return
    problem = stamp_problem(time_ns, now_ns, ahead=ahead, ago=ago, clock=CLOCK_NS)
    if problem:
        raise RequestError(place, problem)


def check_life(place: str, time_to_live: object, *, least: float | None = None) -> None:
    """Check a time to live, s; *place* is its name in messages.

    Raises:
        RequestError: it is no number in the range, or not *least*, which stands for a default.
    """
    life = time_to_live
    if isinstance(life, int | float) and (life == least or 0.0 < life <= LONGEST_LIFE):
        return
    most = f"expected more than 0 and at most {LONGEST_LIFE:g} s"
    raise RequestError(place, f"{most}, got {time_to_live!r}; repeat a target that is to last")


def is_in_world(frame: object, place: str = "velocity_frame") -> bool:
    """Return whether velocities are given in the world frame; *place* is its name in messages.

    Raises:
        RequestError: it is neither that of the body nor that of the world.
    """
    if frame not in get_args(Frame):
        problem = f"expected 'body' or 'world', got {frame!r}; give one of them"
        raise RequestError(place, problem)
    return frame == "world"


def vector_of(given: object, place: str) -> Vector3:
    """Return three numbers as floats; *place* is their name in messages.

    Raises:
        RequestError: they are not three numbers.
    """
    plain = to_plain(given)
    try:
        x, y, z = map(float, plain if isinstance(plain, list) else ())
    except (TypeError, ValueError):
        problem = f"expected three numbers, got {plain!r}; give x, y and z"
        raise RequestError(place, problem) from None
    return x, y, z


def orientation_of(target: object, place: str = "target") -> Orientation:
    """Return the quaternion ``(w, x, y, z)`` of an orientation in any form.

    Args:
        target: a ``Rotation`` of SciPy, a :class:`~orientd.Quaternion`, or a mapping with an
            orientation as in a motion file.
        place: its name in messages.

    Raises:
        RequestError: it is none of these.
    """
    if isinstance(target, Quaternion):
        return (float(target.w), float(target.x), float(target.y), float(target.z))
    mapping = keyframe_mapping(target, place)
    for key in sorted(set(mapping) - set(FORMS)):
        if key in TARGET_KEYS:
            raise RequestError(f"{place}.{key}", "expected next to the orientation, not among it")
        near = did_you_mean(key, [*FORMS, *TARGET_KEYS]) or "; leave it out"
        raise RequestError(place, f"unknown key {key!r}{near}")
    try:
        return read_keyframe(mapping).q
    except RequestError as error:
        raise RequestError(joined(place, error.field), error.problem) from None
