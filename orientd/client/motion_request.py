"""Motion requests as users write them in Python, converted to the mapping of a motion file.

An orientation is a ``scipy.spatial.transform.Rotation``, a :class:`Quaternion` with named
components, or one of the forms of a motion file.  Four bare numbers are refused, because the scalar
among them is ambiguous.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from orientd.errors import RequestError
from orientd.model import MotionRequest, read_request, to_plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EXPECTED = (
    "expected a scipy Rotation, Quaternion(w=, x=, y=, z=), or a mapping with quaternion, "
    "rotation_vector, euler, matrix, direction, azimuth_elevation or look_at"
)


class RequestFields(TypedDict, total=False):
    """The arguments of a motion apart from its keyframes: the fields of a motion file.

    :class:`~orientd.model.MotionRequest` describes them.  These two have a row for each keyframe.

    Attributes:
        times: when each keyframe is passed, s; without them as quickly as the limits permit.
        positions: of the tool at each keyframe, in the world, m.
    """

    times: ArrayLike
    positions: ArrayLike
    method: str
    start_velocity: ArrayLike
    end_velocity: ArrayLike
    velocity_frame: Literal["body", "world"]
    approach: bool
    limits: Mapping[str, float | Sequence[float]]
    duration: Literal["minimum"] | float
    pace: Literal["even"] | float
    options: Mapping[str, Any]
    device_options: Mapping[str, Any]
    name: str
    pointing_axis: Literal["x", "y", "z"]
    frame: str
    frames: Mapping[str, Any]
    rate: ArrayLike
    keep_out: Sequence[Mapping[str, Any]]
    notes: Sequence[str]


def motion_request(
    keyframes: Iterable[object] | MotionRequest, **fields: Unpack[RequestFields]
) -> MotionRequest:
    """Return the request; its keys are those of a motion file.

    Args:
        keyframes: at least one, each a ``Rotation`` of SciPy, a :class:`Quaternion`, or a mapping
            as in a motion file; or a whole request, which is returned unchanged.
        fields: see :class:`RequestFields`.

    Raises:
        RequestError: a value is malformed; the message names the field.
    """
    if isinstance(keyframes, MotionRequest):
        return keyframes
    mapping = {key: to_plain(field) for key, field in fields.items() if field is not None}
    columns = {key: mapping.pop(key, None) for key in ("times", "positions")}
    mapping["keyframes"] = keyframe_mappings(keyframes, **columns)
    return read_request(mapping)


def keyframe_mappings(
    keyframes: Iterable[object],
    *,
    times: Sequence[float] | None = None,
    positions: Sequence[Sequence[float]] | None = None,
) -> list[dict[str, Any]]:
    """Return keyframes as a motion file has them.

    Args:
        keyframes: each an orientation, or a mapping as in a motion file.  A ``Rotation`` of many
            rotations is as many keyframes.
        times: one for each, s; ``None`` if the mappings have them, or if there are none.
        positions: one for each, m.

    Raises:
        RequestError: an item is none of these, or *times* or *positions* differ in number.

    >>> import orientd
    >>> keyframe_mappings([orientd.Quaternion(w=1, x=0, y=0, z=0)], times=[0.5])
    [{'quaternion': {'w': 1, 'x': 0, 'y': 0, 'z': 0}, 'time': 0.5}]
    """
    try:
        iter(keyframes)
    except TypeError:
        is_sequence = False
    else:
        is_sequence = not isinstance(keyframes, Mapping | str)
    if not is_sequence:
        raise RequestError("keyframes", f"expected a sequence, got {type(keyframes).__name__}")
    mappings = [_mapping(keyframe, f"keyframes[{k}]") for k, keyframe in enumerate(keyframes)]
    for key, column in (("time", times), ("position", positions)):
        if column is None:
            continue
        if len(column) != len(mappings):
            raise RequestError(
                f"{key}s", f"expected {len(mappings)}, one for each keyframe, got {len(column)}"
            )
        for k, (mapping, entry) in enumerate(zip(mappings, column, strict=True)):
            if mapping.get(key) is not None:
                raise RequestError(f"keyframes[{k}].{key}", f"given twice, in {key}s too")
            mapping[key] = to_plain(entry)
    return mappings


def _mapping(keyframe: object, place: str) -> dict[str, Any]:
    if isinstance(keyframe, Mapping):
        return {str(key): to_plain(content) for key, content in keyframe.items()}
    if isinstance(keyframe, list | tuple) or hasattr(keyframe, "tolist"):
        raise RequestError(place, f"{EXPECTED}; a bare sequence does not say its order")
    from orientd.rotation import Quaternion, is_rotation

    if isinstance(keyframe, Quaternion):
        return {"quaternion": to_plain(keyframe)}
    if not is_rotation(keyframe):
        raise RequestError(place, f"{EXPECTED}; got {type(keyframe).__name__}")
    if not keyframe.single:  # type: ignore[attr-defined]
        raise RequestError(place, "expected one rotation, got a Rotation of many")
    # SciPy's own order is scalar last.
    x, y, z, w = keyframe.as_quat(canonical=False).tolist()  # type: ignore[attr-defined]
    return {"quaternion": {"w": w, "x": x, "y": y, "z": z}}


def plan_seconds(seconds: float | None) -> float:
    """Return a timeout for planning in the form of a message.

    Raises:
        RequestError: it is not a positive time.
    """
    if seconds is None:
        return 0.0
    if not (isinstance(seconds, int | float) and 0.0 < seconds < math.inf):
        raise RequestError("plan_timeout", f"expected seconds, more than 0, got {seconds!r}")
    return float(seconds)
