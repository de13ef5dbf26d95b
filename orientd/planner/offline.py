"""Plan from Python, with nothing of the daemon: orientations in, a certified motion out."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orientd.errors import RequestError
from orientd.planner.limits import DEFAULT_LIMITS, Limits, Rate
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.request import Keyframe, MotionRequest, State
from orientd.planner.resolve import in_device_coordinates
from orientd.rotation import Quaternion, is_rotation, unnamed
from orientd.spelling import unknown_key


def plan_offline(
    keys: object,
    *,
    times: ArrayLike | None = None,
    positions: ArrayLike | None = None,
    turns: ArrayLike | None = None,
    limits: Limits | Mapping[str, Rate] | None = None,
    period: float = 0.002,
    start: State | None = None,
    **fields: Any,  # noqa: ANN401 - the arguments of a request
) -> Motion:
    """Return the motion through keyframes, certified as for a device.

    Args:
        keys: a ``Rotation`` of SciPy, or a list of such and of named quaternions; or a whole
            request, beside which there are none of *times* to *turns* and of *fields*.
        times: when each is passed, s; ``None`` passes them as quickly as the limits permit.
        positions: of the tool, m, shape ``(n, 3)``.
        turns: whole turns in each interval, shape ``(n - 1,)``.
        limits: of the device; a mapping lowers or raises those of :data:`.DEFAULT_LIMITS`, which
            ``None`` stands for.
        period: of the device, s.
        start: where it is; by default at rest at the first keyframe.
        fields: further arguments of :class:`.MotionRequest`: ``method``, ``start_velocity``,
            ``end_velocity``, ``velocity_frame``, ``approach``, ``duration``, ``pace``,
            ``options``, ``frame``, ``frames``.

    Raises:
        RequestError: something is not well formed, or not possible with the method.
        PlanError: the motion cannot be planned, or would break a limit.
        TypeError: a field stands beside a whole request.
    """
    if isinstance(keys, MotionRequest):
        columns = {"times": times, "positions": positions, "turns": turns}
        beside = [*fields, *(name for name, column in columns.items() if column is not None)]
        if beside:
            raise TypeError(f"a whole request has its own {beside[0]}, got another")
        request = keys
    else:
        known = [one.name for one in dataclasses.fields(MotionRequest) if one.name != "keyframes"]
        for name in fields:
            if name not in known:
                expected = ["times", "positions", "turns", "limits", "period", "start", *known]
                raise RequestError(name, unknown_key(name, expected))
        request = MotionRequest(_keyframes(keys, times, positions, turns), **fields)
    request = in_device_coordinates(request, start)
    if start is None:
        start = State.at_rest(request.keys[0], request.keyframes[0].position or (0.0, 0.0, 0.0))
    if not isinstance(limits, Limits):
        limits = DEFAULT_LIMITS.with_rates(limits or {})
    return plan(request, start=start, limits=limits, period=period)


def _keyframes(
    orientations: object,
    times: ArrayLike | None,
    positions: ArrayLike | None,
    turns: ArrayLike | None,
) -> list[Keyframe]:
    keys = _keys(orientations)
    count = len(keys)
    columns = [
        _column("times", times, count),
        _column("positions", positions, count),
        [0, *_column("turns", turns, count - 1, usual=0)][:count],
    ]
    return [
        Keyframe(tuple(q), time, tuple(position) if isinstance(position, list) else position, turn)
        for q, time, position, turn in zip(keys, *columns, strict=True)
    ]


def _column(
    name: str, given: ArrayLike | None, count: int, *, usual: int | None = None
) -> list[Any]:
    if given is None:
        return [usual] * count
    # As objects entries stay of the type they are: whole turns do not become floats.
    listed = np.asarray(given, dtype=object).tolist()
    if not isinstance(listed, list) or len(listed) != count:
        got = len(listed) if isinstance(listed, list) else repr(listed)
        raise RequestError(name, f"expected {count} of them, got {got}")
    return listed


def _keys(orientations: object) -> list[list[float]]:
    problem = "expected a scipy Rotation or a list of such and of Quaternion(w=, x=, y=, z=)"
    if is_rotation(orientations):
        stacked: list[list[float]] = np.atleast_2d(unnamed(orientations)).tolist()
        return stacked
    if not isinstance(orientations, Iterable):
        raise RequestError("keyframes", f"{problem}, got {type(orientations).__name__}")
    rows = list(orientations)
    for index, row in enumerate(rows):
        if not (isinstance(row, Quaternion) or is_rotation(row)):
            raise RequestError(
                f"keyframes[{index}]", f"{problem}; a bare sequence does not say its order"
            )
    listed: list[list[float]] = [unnamed(row).tolist() for row in rows]
    return listed
