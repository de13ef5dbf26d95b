"""Keyframes that lead a request around keep-out cones, and the request without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from operator import itemgetter
from typing import ClassVar

import numpy as np

from orientd.curves.quintic import quintics
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.motion import Motion
from orientd.planner.state import State
from orientd.rotation import Floats, angle

_SHARES = 101  # points of a rate along a leg
_ENDS = np.array([[0.0], [1.0]])


class Corner(Keyframe):
    """A keyframe around a cone, or the state of the device before one."""

    is_added: ClassVar[bool] = True


def own(request: MotionRequest) -> list[int]:
    """Return the indices of the user's keyframes."""
    return [index for index, one in enumerate(request.keyframes) if not one.is_added]


def own_times(request: MotionRequest, motion: Motion) -> Floats:
    """Return the path times of the user's keyframes in a motion of *request*, s."""
    times: Floats = motion.keyframe_times
    keyframes = own(request)
    if len(keyframes) == len(request.keyframes):
        return times
    return times[-len(request.keyframes) :][keyframes]


def with_corners(
    request: MotionRequest, start: State, corners: Sequence[tuple[int, Floats]]
) -> MotionRequest:
    """Return a request with further keyframes.

    Args:
        request: the request.
        start: the commanded state of the device, which becomes the first keyframe if one follows in
            the lead-in.
        corners: each with the index of the keyframe before which it belongs, in their order.
    """
    keyframes, ordered = list(request.keyframes), sorted(corners, key=itemgetter(0))
    for index, q in reversed(ordered):
        keyframes.insert(index, _corner(q))
    is_led = request.approach and any(index == 0 for index, _ in corners)
    if is_led:
        x, y, z = start.position.tolist()
        keyframes.insert(0, _corner(start.q, None if request.positions is None else (x, y, z)))
    return replace(
        request, keyframes=_timed(request, keyframes), approach=request.approach and not is_led
    )


def with_orientation(request: MotionRequest, index: int, q: Floats) -> MotionRequest:
    """Return a request with another orientation of one keyframe."""
    w, x, y, z = q.tolist()
    keyframes = list(request.keyframes)
    keyframes[index] = replace(keyframes[index], q=(w, x, y, z))
    return replace(request, keyframes=_timed(request, keyframes))


def restored(motion: Motion, request: MotionRequest) -> Motion:
    """Return a motion of *request* as one of the user's keyframes."""
    times = own_times(request, motion)
    begin, end = float(times[0]), float(times[-1])
    certificate = replace(motion.certificate, lead_in=begin, lead_out=motion.duration - end)
    keyframes = [request.keyframes[index] for index in own(request)]
    is_led = request.approach or request.keyframes[0].is_added
    return replace(
        motion, request=replace(request, keyframes=keyframes, approach=is_led), start_time=begin,
        end_time=end, keyframe_times=times, certificate=certificate,
    )  # fmt: skip


def _timed(request: MotionRequest, keyframes: list[Keyframe]) -> list[Keyframe]:
    """Return keyframes with times of the corners, by their distances.

    The rate from one keyframe of the user to the next is zero at an end where the motion rests,
    else that of the mean.
    """
    mine = [index for index, one in enumerate(keyframes) if not one.is_added]
    for first, last in pairwise(mine):
        begin, end = keyframes[first].time, keyframes[last].time
        if begin is None or end is None or last == first + 1:
            continue
        keys = np.array([one.q for one in keyframes[first : last + 1]])
        far = np.concatenate([[0.0], np.cumsum(angle(keys[:-1], keys[1:]))])
        is_rest = first == mine[0] and request.start_velocity is None
        rates = [0.0 if is_rest else 1.0, 1.0]
        if last == mine[-1] and request.end_velocity is None:
            rates[1] = 0.0
        share = np.linspace(0.0, 1.0, _SHARES)
        way = quintics(np.ones(1), _ENDS, np.array(rates)[:, None], np.zeros((2, 1)))
        passed = np.polyval(way[0, ::-1, 0], share)
        times = begin + (end - begin) * np.interp(far[1:-1] / far[-1], passed, share)
        for index, time in enumerate(times.tolist(), first + 1):
            keyframes[index] = replace(keyframes[index], time=time)
    return keyframes


def _corner(q: Floats, place: tuple[float, float, float] | None = None) -> Corner:
    w, x, y, z = q.tolist()
    return Corner((w, x, y, z), None, place)
