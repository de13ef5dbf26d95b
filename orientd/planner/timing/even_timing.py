"""The even timing of a keyframe path: its own, slowed down by one factor until limits are kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from orientd.errors import PlanError, StartError
from orientd.planner import refusal
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.survey import Survey
from orientd.planner.timing.timing import LONGER, shortest

_CYCLES_A_STEP = 4
_LONGEST_SEARCH = 256  # times as long as the first guess, where longer ones are other curves
_MOST_REFUSALS = 10  # of leads, the last one at some four times the duration of the first

Led = TypeVar("Led")


def evenly_paced(
    shape: KeyframePath,
    limits: Limits,
    period: float,
    *,
    intervals: int,
    other: Callable[[float], KeyframePath] | None,
    led: Callable[[KeyframePath], Led],
    everywhere: bool,
    longest: float = LONGEST,
) -> Led | None:
    """Return a path with its leads in the shortest time that keeps the limits.

    Args:
        shape: a path of about that duration.
        limits: to keep, with their reserve.
        period: of the device, s; the path takes a whole number of them.
        intervals: between the keyframes that it passes.
        other: makes the path of another duration, s; ``None`` where that is the same curve at
            another rate.
        led: puts leads to a path.
        everywhere: whether to look at every record at every attempt.
        longest: that it may take, s.

    Returns:
        What *led* made of the path; ``None`` where no duration keeps the limits.

    Raises:
        StartError: as *led* does.
        PlanError: no lead keeps the limits.
    """
    reserved, is_same = limits.with_reserve(), other is None
    is_held = is_same and shape.is_held_at_both_ends(limits)
    survey = Survey.of(shape, reserved, period, has_one_shape=is_same)
    guess = shape.duration * survey.factor
    if is_same:
        refusal.check_duration(guess)
        if guess > longest:
            return None
    # Two steps of the acceleration within a difference of the setpoints would add up.
    fewest = 1 if shape.continuity >= 2 else _CYCLES_A_STEP * intervals
    drafts: dict[int, Led] = {}
    cores: dict[int, KeyframePath] = {}
    refusals: list[PlanError] = []

    def attempt(cycles: int, *, are_led: bool) -> float:
        duration = cycles * period
        try:
            # The same curve at another rate need not be made again.
            keyframe_path = shape.slowed(duration) if other is None else other(duration)
        except PlanError:
            return math.inf
        try:
            factor = survey.look(keyframe_path, reserved, period, everywhere=everywhere)
            if factor <= 1.0:
                cores[cycles] = keyframe_path
                if are_led:
                    drafts[cycles] = led(keyframe_path)
        except StartError:
            raise
        except PlanError as error:
            refusals.append(error)
            if len(refusals) == _MOST_REFUSALS:
                raise
            return LONGER
        return factor

    most = int(longest / period)
    if is_same:
        first = math.ceil(guess / period)
    else:
        # There is a curve of that duration; a longer one may swing out further.
        known = math.ceil(shape.duration / period)
        first = math.ceil(guess / period) if guess <= 2 * known * period else known
        most = min(most, _LONGEST_SEARCH * known)
    if most < fewest:
        return None
    # From hold to hold the leads are the same for any duration.  Elsewhere what is found mostly
    # has leads; otherwise every attempt counts with its own.
    for are_led in (False,) if is_held else (False, True):
        some = partial(attempt, are_led=are_led)
        cycles = shortest(some, first, least=fewest, most=most, has_one_shape=is_same)
        if cycles is None:
            break
        try:
            return drafts[cycles] if cycles in drafts else led(cores[cycles])
        except StartError:
            raise
        except PlanError:
            if is_held:
                raise
            first = cycles
    if refusals:
        raise refusals[-1]
    return None
