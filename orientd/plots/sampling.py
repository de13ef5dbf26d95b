"""Sampling a curve, or a motion, densely enough to be drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from orientd.curves.comparison import MET
from orientd.curves.contract import Curve
from orientd.curves.roles import CurveTask
from orientd.model.limits import Limits
from orientd.plots.charts import MOST_POINTS, Traces
from orientd.rotation import angle

if TYPE_CHECKING:
    from orientd.planner.motion import Motion

INSTANTS = 2000


def traces_of(
    curve: Curve, task: CurveTask, *, limits: Limits | None = None, instants: int = INSTANTS
) -> Traces:
    """Return what there is to draw of a curve that does a task.

    Args:
        curve: on the clock of the task.
        task: keyframes and times.
        limits: to draw; ``None`` for none.
        instants: how many, evenly spaced; both sides of every knot come on top.
    """
    inner = curve.knots[1:-1]
    if len(inner) > instants:
        inner = inner[:0]
    sides = np.concatenate([inner, np.nextafter(inner, -np.inf)])
    times = np.unique(np.concatenate([np.linspace(*curve.domain, instants), sides]))
    q, omega_body, alpha_body = curve.evaluate(times)
    off = angle(curve.evaluate(task.times)[0], task.keys)
    return Traces(
        times=times,
        q=q,
        omega_body=omega_body,
        alpha_body=alpha_body,
        keyframe_times=task.times,
        keyframe_q=task.keys,
        velocity_limit=np.inf if limits is None else limits.velocity,
        acceleration_limit=np.inf if limits is None else limits.acceleration,
        breaks=inner if curve.continuity < 2 else None,
        is_met=bool(off.max() <= MET),
    )


def traces_of_motion(motion: Motion) -> Traces:
    """Return what there is to draw of a planned motion."""
    times = np.linspace(0.0, motion.duration, MOST_POINTS)
    samples = motion.sample(times)
    return Traces(
        times=times,
        q=samples.q,
        omega_body=samples.omega_body,
        alpha_body=samples.alpha_body,
        keyframe_times=motion.keyframe_times,
        keyframe_q=motion.request.keys,
        velocity_limit=motion.limits.velocity,
        acceleration_limit=motion.limits.acceleration,
        keep_out=motion.keep_out,
    )
