"""What callers are told of a motion, as bytes that the daemon only hands on.

Samples are written as a table: a double in a message takes nine bytes wherever it is, so a sample
of which every field is there has always the same length.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from orientd.curves import METHODS
from orientd.errors import RequestError
from orientd.planner import Certificate, Frame, Motion
from orientd.planner import PathSamples as Sampled
from orientd.protocol import Samples, from_request
from orientd.protocol import control_pb2 as pb
from orientd.rotation import Floats

MOST_SAMPLES = 300_000
"""In the answer to one Plan; each takes some 170 bytes of a message."""

EVENT_SAMPLES = 4000
EVENT_RATE_HZ = 50.0
"""Of a motion that starts, as its event has them."""

_FIXED64 = 1
_LENGTH = 2


def plan_of(motion: Motion) -> pb.Plan:
    """Return the plan of *motion*, without samples."""
    return pb.Plan(
        motion_id=motion.id,
        duration=motion.duration,
        start_time=motion.start_time,
        end_time=motion.end_time,
        keyframe_times=motion.keyframe_times.tolist(),
        certificate=certificate(motion.certificate),
        name=motion.request.name,
    )


def certificate(of: Certificate) -> pb.Certificate:
    """Return the message of a certificate; the two have the same fields."""
    figures = [figure._asdict() for figure in of.figures]
    return pb.Certificate(**{**asdict(of), "figures": figures})


def samples_of(motion: Motion, rate_hz: float, frame: Frame | None = None) -> Samples:
    """Return *motion* sampled *rate_hz* times a second, from its beginning to its end.

    Args:
        motion: to sample.
        rate_hz: how often, 1/s.
        frame: what to see it from; ``None`` for the coordinates of the device.
    """
    times, sampled = _sampled(motion, rate_hz, frame)
    return Samples(times, *sampled)


def known_methods() -> list[pb.Method]:
    """Return the families of curves that motions can be made of."""
    return [
        pb.Method(
            name=name,
            summary=family.summary,
            source=family.source,
            interpolates=family.interpolates,
            is_local=family.local,
            meets_end_velocities=family.meets_end_velocities,
        )
        for name, family in METHODS.items()
    ]


def plan_response(motion: Motion, rate_hz: float, frame: Frame | None = None) -> bytes:
    """Return a serialised ``PlanResponse``, or ``GetPlanResponse``, which has the same fields.

    Arguments are those of :func:`samples_of`.

    Raises:
        RequestError: these would be too many samples.
    """
    if rate_hz * motion.duration > MOST_SAMPLES:
        raise RequestError(
            "sample_rate_hz",
            f"{motion.duration:.6g} s make more than {MOST_SAMPLES} samples at {rate_hz:g} Hz",
        )
    response = pb.PlanResponse(plan=plan_of(motion)).SerializeToString()
    if not rate_hz:
        return response
    times, samples = _sampled(motion, rate_hz, frame)
    field = pb.Plan.DESCRIPTOR.fields_by_name["samples"].number
    # Messages put one behind the other are merged: this is the rest of the same plan.
    rest = _samples(field, times, list(samples))
    return response + bytes([1 << 3 | _LENGTH]) + _varint(len(rest)) + rest


def event(motion: Motion) -> bytes:
    """Return a serialised ``Event`` with plan, request and some samples of a motion that starts."""
    message = pb.Event(plan=plan_of(motion), motion=from_request(motion.request))
    times, samples = _sampled(motion, min(EVENT_RATE_HZ, EVENT_SAMPLES / motion.duration))
    field = pb.Event.DESCRIPTOR.fields_by_name["samples"].number
    return message.SerializeToString() + _samples(field, times, list(samples[:2]))


def methods() -> bytes:
    """Return a serialised ``ListMethodsResponse``."""
    return pb.ListMethodsResponse(methods=known_methods()).SerializeToString()


def _sampled(motion: Motion, rate_hz: float, frame: Frame | None = None) -> tuple[Floats, Sampled]:
    """Return instants so many times a second, from beginning to end, and the motion there."""
    count = int(np.floor(motion.duration * rate_hz + 1e-9)) + 1
    times = np.append(np.arange(count) / rate_hz, motion.duration)
    if times[-1] - times[-2] < 1e-9:
        times = times[:-1]
    samples = motion.sample(times)
    return times, samples if frame is None else samples.seen_in(frame)


def _samples(number: int, times: Floats, parts: list[Floats]) -> bytes:
    """Return a repeated field of ``MotionSample``, serialised: times and the first few *parts*."""
    size = 9 + sum(2 + 9 * part.shape[1] for part in parts)
    head = [number << 3 | _LENGTH, *_varint(size)]
    table = np.zeros((len(times), len(head) + size), dtype=np.uint8)
    table[:, : len(head)] = head
    at = _double(table, len(head), 1, times)
    for field, part in enumerate(parts, start=2):
        table[:, at], table[:, at + 1] = field << 3 | _LENGTH, 9 * part.shape[1]
        at += 2
        for k in range(part.shape[1]):
            at = _double(table, at, k + 1, part[:, k])
    return table.tobytes()


def _varint(number: int) -> bytes:
    """Return a length as messages have it: seven bits a byte, the lowest first."""
    parts = []
    while number > 127:
        parts.append(number & 127 | 128)
        number >>= 7
    return bytes([*parts, number])


def _double(
    table: np.ndarray[tuple[int, int], np.dtype[np.uint8]], at: int, field: int, column: Floats
) -> int:
    """Write a field of doubles at byte *at* of every row, and return where the next one goes."""
    table[:, at] = field << 3 | _FIXED64
    content = np.ascontiguousarray(column, dtype="<f8").view(np.uint8)
    table[:, at + 1 : at + 9] = content.reshape(-1, 8)
    return at + 9
