"""What the daemon says about motions, as values for the wire."""

from __future__ import annotations

from orientd.daemon.motions import ActiveMotion, ActiveMotions, Lateness, MotionStatistics
from orientd.rpc import Durations, Statistics, Summary

NANOSECONDS = 1e9


def summary(run: ActiveMotion, runs: ActiveMotions) -> Summary:
    """Return how *run*, which has ended, went beside the others of *runs*."""
    outcome, text = run.ended.result(timeout=0)
    measured = run.device.statistics(run.number)
    lateness, skew = runs.starts(run)
    return Summary(
        motion_number=run.number,
        outcome=outcome,
        text=text,
        statistics=None if measured is None else _statistics(measured),
        settled_after=run.device.settled_after(run.number),
        start_lateness=lateness,
        start_skew=skew,
    )


def _statistics(measured: MotionStatistics) -> Statistics:
    return Statistics(
        cycles=measured.cycles,
        overruns=measured.overruns,
        missed=measured.missed,
        stalls=measured.stalls,
        lateness=_durations(measured.lateness),
        work=_durations(measured.work),
        velocity=measured.velocity,
        acceleration=measured.acceleration,
        jerk=measured.jerk,
        path_error=measured.path_error,
        tracking_error=measured.tracking_error,
        start_velocity_error=measured.start_velocity_error,
        end_velocity_error=measured.end_velocity_error,
    )


def _durations(lateness: Lateness) -> Durations:
    return Durations(
        p50=lateness.p50_ns / NANOSECONDS,
        p99=lateness.p99_ns / NANOSECONDS,
        p99_9=lateness.p99_9_ns / NANOSECONDS,
        largest=lateness.largest_ns / NANOSECONDS,
    )
