"""Plans and motions on the wire: certificate, samples, progress, summary."""

from __future__ import annotations

import numpy as np

from orientd.mechanism import Figure
from orientd.planner import Certificate, Peak
from orientd.rotation import Floats
from orientd.rpc import control_pb2 as pb
from orientd.rpc.reports import (
    Durations,
    MoveTiming,
    Plan,
    Progress,
    Samples,
    Statistics,
    Summary,
)
from orientd.rpc.wire.codec import Codec
from orientd.rpc.wire.values import RATES, to_quaternion, to_vector

FIGURE = Codec(Figure, pb.Figure)
PEAK = Codec(Peak, pb.Peak)
CERTIFICATE = Codec(
    Certificate,
    pb.Certificate,
    names={f"peak_{name}": name for name in RATES},
    kinds={**{f"peak_{name}": PEAK.kind for name in RATES}, "figures": FIGURE.kind},
)
PLAN = Codec(Plan, pb.Plan, kinds={"certificate": CERTIFICATE.kind}, without=("samples",))
PROGRESS = Codec(Progress, pb.MoveProgress, names={"q": "orientation"})
DURATIONS = Codec(Durations, pb.Durations)
STATISTICS = Codec(
    Statistics,
    pb.MotionStatistics,
    kinds={"lateness": DURATIONS.kind, "work": DURATIONS.kind},
)
SUMMARY = Codec(Summary, pb.MoveSummary, kinds={"statistics": STATISTICS.kind})
TIMING = Codec(MoveTiming, pb.MoveTiming)

plan_to_message, plan_from_message = PLAN.to_message, PLAN.from_message
progress_to_message, progress_from_message = PROGRESS.to_message, PROGRESS.from_message
summary_to_message, summary_from_message = SUMMARY.to_message, SUMMARY.from_message
timing_to_message, timing_from_message = TIMING.to_message, TIMING.from_message


def samples_from_messages(messages: list[pb.MotionSample]) -> Samples:
    """Return the arrays that *messages* were made of."""
    return Samples(
        times=np.array([message.path_time for message in messages], dtype=np.float64),
        q=_table([to_quaternion(message.orientation) for message in messages], 4),
        omega_body=_table([to_vector(message.omega_body) for message in messages], 3),
        alpha_body=_table([to_vector(message.alpha_body) for message in messages], 3),
        position=_table([to_vector(message.position) for message in messages], 3),
        velocity=_table([to_vector(message.velocity) for message in messages], 3),
    )


def _table(rows: list[tuple[float, ...]], width: int) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, width)
