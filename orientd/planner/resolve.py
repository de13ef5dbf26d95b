"""Resolve a request for a known start: frames, rates, rolls and whole turns.

All steps work on the arrays of the request.  The result of :func:`resolved` is complete: keyframes
are orientations and positions of the flange in the world, with a roll.  A single keyframe with
whole turns gets intermediate keyframes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from orientd.curves.contract import METHODS
from orientd.curves.quintic import UNIT_ACCELERATION, UNIT_VELOCITY
from orientd.driver import Vector3
from orientd.errors import RequestError, StartError
from orientd.model.limits import Limits
from orientd.model.request import Frame, Keyframe, MotionRequest, Pose
from orientd.planner.methods import can_turn
from orientd.planner.refusal import check_duration, check_velocity
from orientd.planner.state import State
from orientd.rotation import (
    HALF_TURN,
    Floats,
    align,
    are_half_turns,
    between,
    conjugate,
    exp,
    log_half,
    multiply,
    normalize,
    rotate,
)

_DEVICE = Frame()

_OPPOSITE = 1e-12
"""Square of the sine of the angle below which two directions have no common normal."""
_NO_AXIS = 1e-6
"""Largest turn, rad, that is too small to define an axis for whole turns."""
_WINDING_STEP, _RATE_STEP = math.pi / 3, 2.0
"""Distance of intermediate keyframes of whole turns, and of a turn at a rate, rad."""
_SAME_RATE = 1e-6
"""Tolerances for a device that already turns at a rate, rad/s and rad/s^2."""
_SHARE = 0.5
"""Usable share of the limits while the rate builds up: the lead-in may be faster, not shorter."""
_MOST_NOTES = 3
"""Half turns that get a note each; further ones are counted."""


def resolved(request: MotionRequest, start: State, limits: Limits) -> MotionRequest:
    """Return *request* completely resolved.

    Args:
        request: with the frames that it names.
        start: the commanded state of the device.
        limits: limits to keep.

    Raises:
        RequestError: a frame does not exist, or a turn at a rate has keyframes, its own velocities,
            or no duration.
        StartError: whole turns to a single keyframe begin in motion, or have no axis.
    """
    request = at_rate(in_device_coordinates(request, start), start, limits)
    if any(keyframe.free_roll for keyframe in request.keyframes):
        request = _placed(request, start)
    return _wound(request, start)


def report_frame(request: MotionRequest) -> Frame | None:
    """Return the frame for reports of a motion: its own, or the only one of its keyframes.

    ``None`` stands for the coordinates of the device.

    Raises:
        RequestError: the frame does not exist.
    """
    name = request.frame
    if not name:
        names = {keyframe.frame for keyframe in request.keyframes}
        name = names.pop() if len(names) == 1 else ""
    return _named(request.frames, name, "frame") if name else None


def in_device_coordinates(request: MotionRequest, start: State | None) -> MotionRequest:
    """Return the same request in the device's coordinates: the flange in the world.

    This also chooses the roll of keyframes with a pointing direction only, because the pointing
    axis is an axis of the frame's tool.

    Args:
        request: with the frames that it names.
        start: the commanded state of the device; ``None`` if it is unknown.

    Raises:
        RequestError: a frame does not exist; or a keyframe is relative, and *start* is unknown.
    """
    is_framed = request.frame or any(one.frame or one.relative for one in request.keyframes)
    return _placed(request, start) if request.frames or is_framed else request


def _placed(request: MotionRequest, start: State | None) -> MotionRequest:
    """Return *request* in coordinates of the device, with a roll for each free one.

    The roll is the one of the least turn from the previous keyframe: nothing turns about the
    pointing axis.
    """
    given = request.keyframes
    frames = [
        _named(request.frames, one.frame or request.frame, f"keyframes[{index}].frame")
        for index, one in enumerate(given)
    ]
    q_world_base, base = _stacked([frame.base for frame in frames])
    q_flange_tool, tool = _stacked([frame.tool for frame in frames])
    relative = np.flatnonzero([one.relative for one in given])
    if len(relative):
        if start is None:
            problem = "the current orientation is unknown without a daemon"
            raise RequestError(f"keyframes[{relative[0]}].relative", problem)
        q_world_base[relative] = multiply(start.q, q_flange_tool[relative])
        base[relative] = start.position + rotate(start.q, tool[relative])
    q_world_tool = multiply(q_world_base, request.keys)
    keys = normalize(multiply(q_world_tool, conjugate(q_flange_tool)))
    axes = rotate(q_flange_tool, np.eye(3)["xyz".index(request.pointing_axis)])
    directions = rotate(q_world_tool, np.eye(3)[0])
    before = keys[0] if start is None else start.q
    for index, keyframe in enumerate(given):
        if keyframe.free_roll:
            keys[index] = pointed(before, axes[index], directions[index])
        before = keys[index]
    positions = request.positions
    if positions is not None:
        positions = base + rotate(q_world_base, positions) - rotate(keys, tool)
    is_body = request.velocity_frame == "body"
    by, own = (q_flange_tool, frames[0].tool) if is_body else (q_world_base, frames[0].base)
    places = np.zeros((len(keys), 3)) if positions is None else positions
    keyframes = [
        Keyframe((w, x, y, z), one.time, one.position and (a, b, c), one.turns, name=one.name)
        for one, (w, x, y, z), (a, b, c) in zip(given, keys.tolist(), places.tolist(), strict=True)
    ]
    return replace(
        request,
        keyframes=keyframes,
        frame="",
        frames={},
        start_velocity=_turned(by[0], request.start_velocity),
        end_velocity=_turned(by[-1], request.end_velocity),
        rate=_turned(np.array(own.q), request.rate),
    )


def at_rate(request: MotionRequest, start: State, limits: Limits) -> MotionRequest:
    """Return *request* with the keyframes of a turn at its rate, if it has one.

    The device reaches the rate at the first keyframe, which is so far ahead that the device need
    not swing back.  A device that already turns at the rate continues from its orientation.

    Raises:
        RequestError: it has keyframes or its own velocities, or no duration.
        PlanError: the rate is above the limit, or the turn takes days.
    """
    if request.rate is None:
        return request
    if not request.is_single:
        raise RequestError("rate", "starts from the device's orientation; give no keyframes")
    if request.end_velocity is not None:
        raise RequestError("end_velocity", "a turn at a rate ends at rest; give none")
    if request.total is None:
        raise RequestError(
            "duration",
            "expected the seconds for which to turn at the rate; "
            "`orientd turn` without one turns until it is stopped",
        )
    omega = np.array(request.rate)
    if request.velocity_frame == "world":
        omega = rotate(conjugate(start.q), omega)
    speed = float(np.linalg.norm(omega))
    if speed == 0.0:
        raise RequestError("rate", "expected a velocity to turn with, got 0")
    # Before there are keyframes, of which a far too quick or long turn has far too many.
    check_velocity("rate", omega, limits)
    check_duration(request.total)
    apart = [*(start.omega_body - omega), *start.alpha_body, *start.velocity, *start.acceleration]
    goes_on = max(map(abs, apart)) < _SAME_RATE
    # The rate builds up as a quintic.
    ramp = 0.0
    if not goes_on:
        ramp = max(
            UNIT_VELOCITY * speed / (_SHARE * limits.acceleration),
            math.sqrt(UNIT_ACCELERATION * speed / (_SHARE * limits.jerk)),
        )
    count = max(1, math.ceil(speed * request.total / _RATE_STEP))
    times = request.total * np.arange(count + 1) / count
    passed = multiply(start.q, exp((0.5 * ramp + times)[:, None] * omega))
    return replace(
        request, keyframes=_keyframes(passed, times), start_velocity=request.rate,
        end_velocity=request.rate, rate=None, duration=None, pace=None, approach=not goes_on,
    )  # fmt: skip


def pointed(q: Floats, axis: Floats, direction: Floats) -> Floats:
    """Return *q* followed by the least turn that points *axis* in a direction."""
    points = rotate(q, axis)
    if float(np.sum((points + direction) ** 2)) < _OPPOSITE:
        # A half turn, about any axis.
        across = np.cross(points, np.eye(3)[int(np.argmin(np.abs(points)))])
        least = np.concatenate([[0.0], across / np.linalg.norm(across)])
    else:
        half = (points + direction) / np.linalg.norm(points + direction)
        least = np.concatenate([[float(points @ half)], np.cross(points, half)])
    turned = multiply(least, q)
    found: Floats = turned / np.linalg.norm(turned)
    return found


def half_turn_notes(request: MotionRequest, start: State) -> list[str]:
    """Return notes on half turns: the chosen direction, and how to get the other one."""
    keys, places = request.keys, []
    if len(keys) > 1:
        is_half = are_half_turns(keys) & (request.turns[1:] == 0)
        places = (np.flatnonzero(is_half) + 1).tolist()
    is_led = request.approach and start.is_at_rest and request.omega_start is None
    if is_led and not request.turns[0] and abs(float(start.q @ keys[0])) <= HALF_TURN:
        places.insert(0, 0)
    notes = []
    for index in places[:_MOST_NOTES]:
        # The lead-in to the first of several keyframes makes no extra turns.
        can = request.is_single or (index > 0 and can_turn(METHODS[request.method]))
        way = "`turns: -1` there" if can else "a keyframe on the way"
        axis = _axis_in_words(keys[index - 1] if index else start.q, keys[index])
        notes.append(
            f"{request.named(index)} is half a turn away: turned about {axis} in the body frame; "
            f"{way} chooses the other way"
        )
    if len(places) > _MOST_NOTES:
        more = len(places) - _MOST_NOTES
        notes.append(f"{more} more keyframes are half a turn from the one before")
    return notes


def _wound(request: MotionRequest, start: State) -> MotionRequest:
    """Return *request* with intermediate keyframes, if its only one has whole turns."""
    if not (request.is_single and request.turns[0]):
        return request
    if not start.is_at_rest:
        raise StartError("whole turns to a single keyframe begin at rest")
    shortest = 2.0 * log_half(between(*align([start.q, request.keys[0]])))
    size = float(np.linalg.norm(shortest))
    if size < _NO_AXIS:
        raise StartError("it is there already, so the axis of the turn is undefined")
    whole = shortest * (1.0 + 2.0 * math.pi * int(request.turns[0]) / size)
    count = math.ceil(float(np.linalg.norm(whole)) / _WINDING_STEP)
    passed = multiply(start.q, exp(whole * np.linspace(0.0, 1.0, count + 1)[:-1, None]))
    last = replace(request.keyframes[0], turns=0)
    return replace(request, keyframes=[*_keyframes(passed), last], approach=False)


def _keyframes(keys: Floats, times: Floats | None = None) -> list[Keyframe]:
    seconds = [None] * len(keys) if times is None else times.tolist()
    return [
        Keyframe((w, x, y, z), t) for (w, x, y, z), t in zip(keys.tolist(), seconds, strict=True)
    ]


def _named(frames: Mapping[str, Frame], name: str, field: str) -> Frame:
    """Return a frame by its name; the empty name is the device's own frame."""
    if not name:
        return _DEVICE
    if name not in frames:
        known = ", ".join(frames)
        expected = f"expected one of {known}" if known else "there are no frames here"
        step = "" if known else "; define it in `frames` of the motion or of the device"
        raise RequestError(field, f"{expected}, got {name!r}{step}")
    return frames[name]


def _stacked(poses: Sequence[Pose]) -> tuple[Floats, Floats]:
    return np.array([pose.q for pose in poses]), np.array([pose.position for pose in poses])


def _turned(q: Floats, velocity: Vector3 | None) -> Vector3 | None:
    if velocity is None:
        return None
    x, y, z = rotate(q, velocity).tolist()
    return x, y, z


def _axis_in_words(before: Floats, here: Floats) -> str:
    """Return the axis of the half turn from one orientation to another."""
    axis = between(*align([before, here]))[1:]
    axis /= np.linalg.norm(axis)
    largest = int(np.argmax(np.abs(axis)))
    if abs(abs(axis[largest]) - 1.0) < 1e-6:
        return ("+" if axis[largest] > 0.0 else "-") + "xyz"[largest]
    return "[" + ", ".join(f"{part:.4g}" for part in np.round(axis, 6)) + "]"
