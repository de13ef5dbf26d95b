"""Motion requests as users write them in Python, converted to the mapping of a motion file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from orientd.errors import RequestError
from orientd.model.keyframes import keyframe_mappings
from orientd.model.plain import to_plain
from orientd.model.reading import read_request
from orientd.model.request import MotionRequest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class RequestFields(TypedDict, total=False):
    """The arguments of a motion apart from its keyframes: the fields of a motion file.

    :class:`.MotionRequest` describes them.  These two have a row for each keyframe.

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
