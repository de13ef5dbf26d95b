"""What a family of curves says of itself, and what a curve of it was made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar

import numpy as np

END_STATES = ("start", "end", "omega_start", "omega_end", "alpha_start", "alpha_end")
"""Parameters of a family whose ends have conditions and states of motion."""


class Family:
    """A class of curves, with the parameters that its constructor takes.

    Attributes:
        name: the key of the family in ``METHODS``.
        summary: one line for a list of the families.
        source: author, year and equation.
        interpolates: whether the curve passes through every keyframe at its time.
        local: whether moving a keyframe changes the curve near that keyframe only.
        meets_end_velocities: whether angular velocities can be prescribed at both ends.
        meets_end_accelerations: whether accelerations can be prescribed with them.
        takes: the family's own names of its parameters, in order.
            :mod:`orientd.curves.roles` reads from them what keyframes are to the family.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    source: ClassVar[str]
    interpolates: ClassVar[bool] = False
    local: ClassVar[bool] = False
    meets_end_velocities: ClassVar[bool] = False
    meets_end_accelerations: ClassVar[bool] = False
    takes: ClassVar[tuple[str, ...]] = ()


def kept(value: object) -> object:
    """Return a parameter that nobody else can change."""
    if isinstance(value, list | tuple):
        value = np.array(value)
    elif isinstance(value, np.ndarray):
        value = value.copy()
    else:
        return value
    value.setflags(write=False)
    return value


def is_same(one: object, other: object) -> bool:
    """Return whether two values were made of the same: arrays and lists by their entries."""
    if one is other:
        return True
    if isinstance(one, np.ndarray | list | tuple) or isinstance(other, np.ndarray | list | tuple):
        return _has_same_entries(one, other)
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(is_same(one[key], other[key]) for key in one)
    if type(one) is type(other) and is_dataclass(one) and type(one).__eq__ is object.__eq__:
        names = [entry.name for entry in fields(one) if entry.compare]
        return all(is_same(getattr(one, name), getattr(other, name)) for name in names)
    return bool(one == other)


def _has_same_entries(one: Any, other: Any) -> bool:  # noqa: ANN401
    try:
        return np.array_equal(np.asarray(one), np.asarray(other), equal_nan=True)
    except (TypeError, ValueError):
        # Of several kinds, or of several lengths.
        return len(one) == len(other) and all(map(is_same, one, other))
