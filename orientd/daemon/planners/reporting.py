"""Reports of a planned motion, as bytes that the daemon only hands on."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from orientd.curves.contract import METHODS
from orientd.errors import RequestError
from orientd.model.request import Frame
from orientd.planner.motion import Motion
from orientd.planner.path import PathSamples as Sampled
from orientd.protocol import control_pb2 as pb
from orientd.protocol.cones import cone_message
from orientd.protocol.reports import Samples
from orientd.protocol.values import quaternion, vector
from orientd.rotation import Floats

MOST_SAMPLES = 300_000
"""In the answer to one Plan; each takes 136 bytes of a message."""

EVENT_SAMPLES = 4000
EVENT_RATE_HZ = 50.0
"""Of a motion that starts, as its event has them."""


def plan_of(motion: Motion) -> pb.Plan:
    """Return the plan of *motion*, without samples."""
    of = motion.certificate
    # The message of a certificate has the same fields.
    figures = [figure._asdict() for figure in of.figures]
    losses = [loss._asdict() for loss in of.losses]
    certificate = pb.Certificate(**{**asdict(of), "figures": figures, "losses": losses})
    return pb.Plan(
        motion_id=motion.id,
        duration=motion.duration,
        start_time=motion.start_time,
        end_time=motion.end_time,
        keyframe_times=motion.keyframe_times.tolist(),
        certificate=certificate,
        name=motion.request.name,
        keep_out=map(cone_message, motion.keep_out),
    )


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


def plan_samples(motion: Motion, rate_hz: float, frame: Frame | None = None) -> bytes:
    """Return a serialised ``Plan`` with samples alone; arguments are those of :func:`samples_of`.

    Raises:
        RequestError: these would be too many samples.
    """
    if rate_hz * motion.duration > MOST_SAMPLES:
        raise RequestError(
            "sample_rate_hz",
            f"{motion.duration:.6g} s make more than {MOST_SAMPLES} samples at {rate_hz:g} Hz",
        )
    times, samples = _sampled(motion, rate_hz, frame)
    columns = {name: part.ravel().tolist() for name, part in samples._asdict().items()}
    message = pb.Plan(samples=pb.MotionColumns(path_times=times.tolist(), **columns))
    return message.SerializeToString()


def event_samples(motion: Motion) -> bytes:
    """Return a serialised ``Event`` with some samples of a motion that starts, and nothing else."""
    times, samples = _sampled(motion, min(EVENT_RATE_HZ, EVENT_SAMPLES / motion.duration))
    rows = zip(times.tolist(), samples.q.tolist(), samples.omega_body.tolist(), strict=True)
    messages = [
        pb.MotionSample(path_time=time, q=quaternion(q), omega_body=vector(omega))
        for time, q, omega in rows
    ]
    return pb.Event(samples=messages).SerializeToString()


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
