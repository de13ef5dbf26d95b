"""Cycles as plain numbers, one message each, for tools that plot whatever is a number."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orientd.recorder.cycle_table import Table
from orientd.recorder.recording_pb2 import Scalars
from orientd.rotation import angle
from orientd.stream import CycleFlag

_SENT = ("sent_q", "sent_omega_body", "sent_alpha_body", "sent_position")
_MEASURED = ("measured_q", "measured_omega_body", "measured_position")


def scalars_of(cycles: Table, offset_ns: int) -> Iterator[tuple[int, Scalars]]:
    """Yield for each cycle the time of day at which it was due, ns, and its numbers.

    Args:
        cycles: of one device.
        offset_ns: from the monotonic clock to the time of day.
    """
    sent_q, omega, alpha, place = (cycles[name] for name in _SENT)
    speed, acceleration = (np.linalg.norm(rate, axis=-1)[:, None] for rate in (omega, alpha))
    sent = np.hstack([sent_q, omega, speed, alpha, acceleration, place]).tolist()
    q, *rest = (cycles[name] for name in _MEASURED)
    q = np.where(np.sum(q * sent_q, axis=-1)[:, None] < 0.0, -q, q)
    age = (cycles["deadline_ns"] - cycles["feedback_time_ns"])[:, None] * 1e-9
    measured = np.hstack([q, *rest, age]).tolist()
    is_told = (cycles["flags"] & CycleFlag.FEEDBACK != 0).tolist()
    errors = np.where(is_told, angle(sent_q, q), 0.0).tolist()
    for k, (time_ns, lateness, work, path_speed, state, motion) in enumerate(
        zip(
            (cycles["deadline_ns"] + offset_ns).tolist(),
            (cycles["lateness_ns"] * 1e-9).tolist(),
            (cycles["work_ns"] * 1e-9).tolist(),
            *(cycles[name].tolist() for name in ("speed", "state", "motion")),
            strict=True,
        )
    ):
        message = Scalars(
            sent=Scalars.Sent(**dict(zip(_SENT_NAMES, sent[k], strict=True))),
            lateness=lateness,
            work=work,
            path_speed=path_speed,
            state=state,
            motion=motion,
        )
        if is_told[k]:
            names = dict(zip(_MEASURED_NAMES, measured[k], strict=True))
            message.measured.CopyFrom(Scalars.Measured(**names))
            message.tracking_error = errors[k]
        yield time_ns, message


_SENT_NAMES = tuple(Scalars.Sent.DESCRIPTOR.fields_by_name)
_MEASURED_NAMES = tuple(Scalars.Measured.DESCRIPTOR.fields_by_name)
