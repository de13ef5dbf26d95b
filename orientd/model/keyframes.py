"""Keyframes as users write them in Python, converted to the mappings of a motion file.

An orientation is a ``scipy.spatial.transform.Rotation``, a :class:`~orientd.Quaternion` with named
components, or one of the forms of a motion file.  Four bare numbers are refused, because the scalar
among them is ambiguous.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from orientd.errors import RequestError
from orientd.model.plain import shown, to_plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EXPECTED = (
    "expected a scipy Rotation, Quaternion(w=, x=, y=, z=), or a mapping with quaternion, "
    "rotation_vector, euler, matrix, direction, azimuth_elevation or look_at"
)

_COLUMNS = (("time", 0, "keyframe"), ("position", 0, "keyframe"), ("turns", 1, "interval"))
"""Each column: the key of its entries, the first keyframe that has one, and what has one each."""


def keyframe_mappings(
    keyframes: Iterable[object],
    *,
    times: ArrayLike | None = None,
    positions: ArrayLike | None = None,
    turns: ArrayLike | None = None,
) -> list[dict[str, Any]]:
    """Return keyframes as a motion file has them.

    Args:
        keyframes: each an orientation, or a mapping as in a motion file.  A ``Rotation`` of many
            rotations is as many keyframes.
        times: one for each, s; ``None`` if the mappings have them, or if there are none.
        positions: one for each, m.
        turns: whole turns in each interval, one less than the keyframes.

    Raises:
        RequestError: an item is none of these, or a column has another number of entries.

    >>> import orientd
    >>> keyframe_mappings([orientd.Quaternion(w=1, x=0, y=0, z=0)], times=[0.5])
    [{'quaternion': {'w': 1, 'x': 0, 'y': 0, 'z': 0}, 'time': 0.5}]
    """
    if getattr(keyframes, "single", False):
        keyframes = [keyframes]  # a Rotation of one rotation
    try:
        iter(keyframes)
    except TypeError:
        is_sequence = False
    else:
        is_sequence = not isinstance(keyframes, Mapping | str)
    if not is_sequence:
        raise RequestError("keyframes", f"expected a sequence, got {type(keyframes).__name__}")
    mappings = [
        keyframe_mapping(keyframe, f"keyframes[{k}]") for k, keyframe in enumerate(keyframes)
    ]
    columns = {"time": times, "position": positions, "turns": turns}
    for key, first, each in _COLUMNS:
        if columns[key] is None:
            continue
        field, column = key if key == "turns" else f"{key}s", to_plain(columns[key])
        count = len(mappings) - first
        if not isinstance(column, list) or len(column) != count:
            got = len(column) if isinstance(column, list) else repr(column)
            raise RequestError(field, f"expected {count}, one for each {each}, got {got}")
        for k, entry in enumerate(column, first):
            if mappings[k].get(key) is not None:
                raise RequestError(f"keyframes[{k}].{key}", f"given twice, in {field} too")
            mappings[k][key] = entry
    return mappings


def keyframe_mapping(keyframe: object, place: str) -> dict[str, Any]:
    """Return one keyframe as a motion file has it.

    Args:
        keyframe: an orientation, or a mapping as in a motion file.
        place: its name in messages.

    Raises:
        RequestError: it is neither.
    """
    if isinstance(keyframe, Mapping):
        return {str(key): to_plain(content) for key, content in keyframe.items()}
    if isinstance(keyframe, list | tuple) or hasattr(keyframe, "tolist"):
        step = "name its components: a bare sequence does not say its order"
        raise RequestError(place, f"{EXPECTED}, got {shown(to_plain(keyframe))}; {step}")
    from orientd.rotation import Quaternion, is_rotation

    if isinstance(keyframe, Quaternion):
        return {"quaternion": to_plain(keyframe)}
    if not is_rotation(keyframe):
        raise RequestError(place, f"{EXPECTED}; got {type(keyframe).__name__}")
    if not keyframe.single:  # type: ignore[attr-defined]
        raise RequestError(place, "expected one rotation, got a Rotation of many; give one of them")
    # SciPy's own order is scalar last.
    x, y, z, w = keyframe.as_quat(canonical=False).tolist()  # type: ignore[attr-defined]
    return {"quaternion": {"w": w, "x": x, "y": y, "z": z}}
