"""Plans and motions on the wire: certificate, samples, progress, summary."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from orientd.driver import Figure
from orientd.planner import Certificate, Peak
from orientd.rotation import Floats
from orientd.rpc import control_pb2 as pb
from orientd.rpc.reports import (
    Durations,
    MoveTiming,
    Outcome,
    Plan,
    Progress,
    Samples,
    Statistics,
    Summary,
)
from orientd.rpc.wire.values import (
    RATES,
    STATES,
    STATES_BACK,
    quaternion,
    to_quaternion,
    to_vector,
    vector,
)

_OUTCOMES = {
    Outcome.DONE: pb.OUTCOME_DONE,
    Outcome.STOPPED: pb.OUTCOME_STOPPED,
    Outcome.FAULT: pb.OUTCOME_FAULT,
    Outcome.REPLACED: pb.OUTCOME_REPLACED,
    Outcome.UNSETTLED: pb.OUTCOME_UNSETTLED,
}
_OUTCOMES_BACK = {number: outcome for outcome, number in _OUTCOMES.items()}

_OPTIONAL = ("settled_after", "start_lateness", "start_skew")

_CERTIFIED = (
    "rate_hz",
    "duration",
    "lead_in",
    "lead_out",
    "start_velocity_error",
    "end_velocity_error",
    "keyframe_error",
    "brake_rate",
    "stop_time",
)
_MEASURED = (
    "cycles",
    "overruns",
    "missed",
    "velocity",
    "acceleration",
    "jerk",
    "path_error",
    "tracking_error",
    "start_velocity_error",
    "end_velocity_error",
)


def plan_to_message(plan: Plan) -> pb.Plan:
    """Return *plan* as a message."""
    certificate = plan.certificate
    message = pb.Plan(
        motion_id=plan.motion_id,
        duration=plan.duration,
        start_time=plan.start_time,
        end_time=plan.end_time,
        keyframe_times=plan.keyframe_times,
        certificate=pb.Certificate(**{name: getattr(certificate, name) for name in _CERTIFIED}),
    )
    for name in RATES:
        peak = _peak(getattr(certificate, f"peak_{name}"))
        getattr(message.certificate, name).CopyFrom(peak)
    message.certificate.figures.extend(pb.Figure(**of._asdict()) for of in certificate.figures)
    message.certificate.notes.extend(certificate.notes)
    return message


def plan_from_message(message: pb.Plan, samples: Samples | None = None) -> Plan:
    """Return the plan that *message* was made of, with its samples where there are any."""
    certificate = message.certificate
    return Plan(
        motion_id=message.motion_id,
        duration=message.duration,
        start_time=message.start_time,
        end_time=message.end_time,
        keyframe_times=tuple(message.keyframe_times),
        certificate=Certificate(
            **{name: getattr(certificate, name) for name in _CERTIFIED},
            peak_velocity=_to_peak(certificate.velocity),
            peak_acceleration=_to_peak(certificate.acceleration),
            peak_jerk=_to_peak(certificate.jerk),
            peak_linear_velocity=_to_peak(certificate.linear_velocity),
            peak_linear_acceleration=_to_peak(certificate.linear_acceleration),
            figures=tuple(_to_figure(figure) for figure in certificate.figures),
            notes=tuple(certificate.notes),
        ),
        samples=samples,
    )


def samples_to_messages(samples: Samples) -> list[pb.MotionSample]:
    """Return one message for each instant."""
    columns = zip(
        samples.times.tolist(),
        samples.q.tolist(),
        samples.omega_body.tolist(),
        samples.alpha_body.tolist(),
        samples.position.tolist(),
        samples.velocity.tolist(),
        strict=True,
    )
    return [
        pb.MotionSample(
            path_time=time,
            orientation=quaternion(q),
            omega_body=vector(omega),
            alpha_body=vector(alpha),
            position=vector(position),
            velocity=vector(velocity),
        )
        for time, q, omega, alpha, position, velocity in columns
    ]


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


def progress_to_message(progress: Progress) -> pb.MoveProgress:
    """Return *progress* as a message."""
    return pb.MoveProgress(
        path_time=progress.path_time,
        duration=progress.duration,
        state=STATES[progress.state],
        is_paused=progress.is_paused,
        speed=progress.speed,
        orientation=quaternion(progress.q),
        omega_body=vector(progress.omega_body),
        position=vector(progress.position),
        lateness=progress.lateness,
        tracking_error=progress.tracking_error,
        overruns=progress.overruns,
    )


def progress_from_message(message: pb.MoveProgress) -> Progress:
    """Return the progress that *message* was made of."""
    return Progress(
        path_time=message.path_time,
        duration=message.duration,
        state=STATES_BACK[message.state],
        is_paused=message.is_paused,
        speed=message.speed,
        q=to_quaternion(message.orientation),
        omega_body=to_vector(message.omega_body),
        position=to_vector(message.position),
        lateness=message.lateness,
        tracking_error=message.tracking_error if message.HasField("tracking_error") else None,
        overruns=message.overruns,
    )


def summary_to_message(summary: Summary) -> pb.MoveSummary:
    """Return *summary* as a message."""
    message = pb.MoveSummary(
        motion_number=summary.motion_number,
        outcome=_OUTCOMES[summary.outcome],
        text=summary.text,
        **{name: getattr(summary, name) for name in _OPTIONAL},
    )
    statistics = summary.statistics
    if statistics is not None:
        message.statistics.CopyFrom(
            pb.MotionStatistics(
                **{name: getattr(statistics, name) for name in _MEASURED},
                lateness=_durations(statistics.lateness),
                work=_durations(statistics.work),
            )
        )
    return message


def summary_from_message(message: pb.MoveSummary) -> Summary:
    """Return the summary that *message* was made of."""
    return Summary(
        motion_number=message.motion_number,
        outcome=_OUTCOMES_BACK[message.outcome],
        text=message.text,
        statistics=_to_statistics(message.statistics) if message.HasField("statistics") else None,
        **{name: getattr(message, name) if message.HasField(name) else None for name in _OPTIONAL},
    )


def timing_to_message(timing: MoveTiming) -> pb.MoveTiming:
    """Return *timing* as a message."""
    return pb.MoveTiming(**asdict(timing))


def timing_from_message(message: pb.MoveTiming) -> MoveTiming:
    """Return the timing that *message* was made of."""
    return MoveTiming(message.planning, message.splicing, message.received_ns, message.attempts)


def _to_statistics(message: pb.MotionStatistics) -> Statistics:
    measured = {name: getattr(message, name) for name in _MEASURED}
    for name in ("start_velocity_error", "end_velocity_error"):
        if not message.HasField(name):
            measured[name] = None
    return Statistics(
        **measured,
        lateness=_to_durations(message.lateness),
        work=_to_durations(message.work),
    )


def _durations(durations: Durations) -> pb.Durations:
    return pb.Durations(
        p50=durations.p50, p99=durations.p99, p99_9=durations.p99_9, largest=durations.largest
    )


def _to_durations(message: pb.Durations) -> Durations:
    return Durations(message.p50, message.p99, message.p99_9, message.largest)


def _peak(peak: Peak) -> pb.Peak:
    return pb.Peak(value=peak.value, time=peak.time, limit=peak.limit)


def _to_peak(message: pb.Peak) -> Peak:
    return Peak(message.value, message.time, message.limit)


def _to_figure(message: pb.Figure) -> Figure:
    return Figure(
        message.name,
        message.value,
        message.unit,
        message.limit if message.HasField("limit") else None,
        message.time if message.HasField("time") else None,
    )


def _table(rows: list[tuple[float, ...]], width: int) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, width)
