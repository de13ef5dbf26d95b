"""Drafts: a core with its leads, from hold to hold, not yet held against the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.errors import PlanError
from orientd.planner import refusal
from orientd.planner.certificate import Rough
from orientd.planner.course import Core
from orientd.planner.lead import approach, approach_cycles, is_still, lead_out
from orientd.planner.limits import Limits
from orientd.planner.path import Path, Stretch
from orientd.planner.request import MotionRequest, State
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """A path that has not been checked yet.

    Attributes:
        path: from hold to hold.
        begin: path time of the first keyframe, s; a whole number of periods.
        end: path time of the last keyframe, s.
        keyframe_times: path times of all keyframes, s.
        rough: the part whose acceleration has steps; ``None`` if there is none.
    """

    path: Path
    begin: float
    end: float
    keyframe_times: Floats
    rough: Rough | None


def with_leads(
    core: Core, request: MotionRequest, start: State, limits: Limits, period: float
) -> Draft:
    """Return the path from hold to hold around a core.

    In front goes an approach from rest to rest and the run-up that follows it, as far as they are
    needed and the request asks for them; behind goes a lead-out if the core does not end at rest.

    Args:
        core: from the first keyframe to the last.
        request: says whether to lead in.
        start: where the device is commanded to be.
        limits: to keep.
        period: of the device, s.

    Raises:
        StartError: there is to be no lead-in, and the core begins elsewhere.
        PlanError: no lead keeps the limits.
    """
    first, last = core.stretch.ends()
    stretches: list[Stretch] = []
    positions, cycles = core.positions, 0
    if request.approach and start.is_at_rest:
        run_up = None
        rest = first.q
        if not is_still(first.omega_body, first.alpha_body, limits):
            try:
                run_up = lead_out(
                    first.q, -first.omega_body, first.alpha_body, limits=limits, period=period
                )
            except PlanError as error:
                raise PlanError(f"no run-up to the first keyframe: {error}") from error
            rest = run_up.evaluate(np.array([run_up.domain[1]]))[0][0]
        cycles = approach_cycles(
            start.q, rest, start.position, positions.first, limits=limits, period=period
        )
        if cycles:
            curve = approach(start.q, rest, cycles * period)
            stretches.append(Stretch(curve, 0.0, cycles * period))
        arrival = cycles * period
        if run_up is not None:
            cycles += round(run_up.domain[1] / period)
            stretches.append(Stretch(run_up, arrival, cycles * period, rate=-1.0))
        # The position arrives with the approach and waits while the orientation takes its run-up.
        positions = positions.delayed(cycles * period)
        positions = positions.after_move_from(start.position, 0.0, arrival)
    else:
        state = State(first.q, first.omega_body, first.alpha_body, positions.first)
        refusal.check_start(start, state, limits)
    begin = cycles * period
    end = begin + core.duration
    stretches.append(core.stretch.shifted(begin))
    if not is_still(last.omega_body, last.alpha_body, limits):
        try:
            curve = lead_out(last.q, last.omega_body, last.alpha_body, limits=limits, period=period)
        except PlanError as error:
            raise PlanError(f"no lead-out from the last keyframe: {error}") from error
        stretches.append(Stretch(curve, end, end + curve.domain[1]))
    return Draft(
        Path.joined(stretches, positions), begin, end, core.times + begin, _rough(core, begin)
    )


def _rough(core: Core, begin: float) -> Rough | None:
    """Return where the derivatives of a core have steps, from its first inner knot to its last."""
    curve = core.stretch.curve
    if core.continuity >= 2 or len(curve.knots) < 3:
        return None
    inner = (curve.knots[[1, -2]] - curve.domain[0]) / core.stretch.rate
    return Rough(begin + float(inner[0]), begin + float(inner[1]), core.continuity)
