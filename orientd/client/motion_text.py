"""Motions as users write them in Python, as the text that a motion file would have."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypedDict, Unpack

from orientd.errors import RequestError
from orientd.files import MOST_BYTES, MOST_VALUES, file_content
from orientd.model.keyframes import keyframe_mappings
from orientd.model.plain import to_plain
from orientd.protocol import control_pb2 as pb
from orientd.protocol.columns import keyframe_columns
from orientd.protocol.values import embedded, field_number

if TYPE_CHECKING:
    from typing import TypeAlias

    from numpy.typing import ArrayLike

    from orientd.model.request import MotionRequest
    from orientd.planner.motion import Motion

    Keyframes: TypeAlias = Iterable[object] | str | Path | MotionRequest | Motion
    """Keyframes, a motion file, a whole request, or a motion that is planned already."""

_MANY = 1000
"""Keyframes from which on they are sent as columns, if they have such a form."""

_ANY = [{"rotation_vector": [0.0, 0.0, 0.0]}]


class MotionText(NamedTuple):
    """A motion as the daemon gets it; the planner reads it.

    Attributes:
        text: of a motion file, YAML or JSON.
        source: name of the file, for errors; empty if there is none.
        columns: keyframes as a serialised ``KeyframeColumns``, in place of those of the text.
    """

    text: bytes
    source: str = ""
    columns: bytes = b""


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


def motion_text(keyframes: Keyframes | MotionText, **fields: Unpack[RequestFields]) -> MotionText:
    """Return a motion as it is sent.

    Args:
        keyframes: at least one, each a ``Rotation`` of SciPy, a :class:`Quaternion`, or a mapping
            as in a motion file.  Or the path of a motion file, or a whole :class:`.MotionRequest`.
            Or a :class:`.Motion`: its request is planned for the device.
        fields: see :class:`RequestFields`; the other forms of *keyframes* have their own.

    Raises:
        RequestError: it has no text; the message names the field.  The planner checks the values.
        TypeError: a field is given together with a motion file or a whole request.
    """
    if isinstance(keyframes, str):
        keyframes = Path(keyframes)
    elif hasattr(keyframes, "request"):
        keyframes = keyframes.request
    given: dict[str, Any] = {key: value for key, value in fields.items() if value is not None}
    is_whole = isinstance(keyframes, MotionText | Path) or hasattr(keyframes, "keyframes")
    if is_whole and given:
        kind = "a motion file" if isinstance(keyframes, Path) else "a whole request"
        raise TypeError(f"{kind} has its own {next(iter(given))}, got another")
    if isinstance(keyframes, MotionText):
        return keyframes
    if isinstance(keyframes, Path):
        try:
            return MotionText(file_content(keyframes), str(keyframes))
        except RequestError:
            if keyframes.is_file():
                from orientd import motion_file

                motion_file.content(keyframes)  # says more of a recording
            raise
    if hasattr(keyframes, "keyframes"):
        from orientd.model.reading import written

        return _sent(written(keyframes))  # type: ignore[arg-type] # a MotionRequest
    columns = {key: given.pop(key, None) for key in ("times", "positions")}
    plain = {key: to_plain(value) for key, value in given.items()}
    packed = _packed_rotations(keyframes, **columns)
    if packed is not None:
        return MotionText(_text({**plain, "keyframes": []}), "", packed)
    return _sent({**plain, "keyframes": keyframe_mappings(keyframes, **columns)})


def _sent(mapping: dict[str, Any]) -> MotionText:
    """Return the content of a motion file as it is sent.

    Raises:
        RequestError: it is too large for a text and for columns.
    """
    keyframes = mapping["keyframes"]
    columns = keyframe_columns(keyframes) if len(keyframes) > _MANY else None
    if columns is None:
        text = _text(mapping)
        # Each value but the first follows one of these.
        if len(text) <= MOST_BYTES and sum(map(text.count, b",[{")) <= MOST_VALUES:
            return MotionText(text)
        # The quaternions of any other form are small enough.
        from orientd.model.reading import read_request, written

        mapping = written(read_request(mapping))
        columns = keyframe_columns(mapping["keyframes"])
        if columns is None:
            problem = f"expected at most {MOST_BYTES >> 20} MiB and {MOST_VALUES} values as a text"
            raise RequestError("keyframes", problem)
    return MotionText(_text({**mapping, "keyframes": []}), "", columns)


def _text(mapping: dict[str, Any]) -> bytes:
    """Return the text of a motion file.

    Raises:
        RequestError: a value is no plain one.
    """
    try:
        return json.dumps(mapping, default=_plain_number).encode()
    except (OverflowError, TypeError, ValueError):
        from orientd.model.reading import read_request

        # Names the field, which is none of the keyframes that are sent as columns.
        read_request({**mapping, "keyframes": mapping["keyframes"] or _ANY})
        raise RequestError("", "expected plain values only") from None


def _plain_number(value: Any) -> float:  # noqa: ANN401 - any value of a request
    """Return a number of another type, such as ``Decimal``.

    Raises:
        TypeError: it is no number.
    """
    # float() would also read texts.
    if not hasattr(value, "__float__"):
        raise TypeError(f"expected a number, got {value!r}")
    return float(value)


def _packed_rotations(
    keyframes: Any,  # noqa: ANN401 - what users write
    times: ArrayLike | None,
    positions: ArrayLike | None,
) -> bytes | None:
    """Return a large ``Rotation`` as a serialised ``KeyframeColumns``, without Python's objects.

    Returns:
        ``None`` if it is something else, or its times or positions are no such arrays of numbers.
    """
    if getattr(keyframes, "single", True) or len(keyframes) <= _MANY:
        return None
    import numpy as np

    # SciPy's own order is scalar last.
    packed = {"quaternions": np.roll(keyframes.as_quat(canonical=False), 1, axis=-1)}
    for name, given, shape in (("times", times, ()), ("positions", positions, (3,))):
        if given is None:
            continue
        if np.ma.isMaskedArray(given):
            return None  # whose masked entries would count
        column = np.asarray(given)
        if column.dtype.kind not in "fiu" or column.shape != (len(keyframes), *shape):
            return None
        # A position that is not a number would stand for none.
        if not np.isfinite(column).all():
            return None
        packed[name] = column
    return b"".join(
        embedded(field_number(pb.KeyframeColumns, name), column.astype("<f8").tobytes())
        for name, column in packed.items()
    )


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
