"""Values of URScript: lists and poses with their arithmetic, and their text form."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

Datum: TypeAlias = Any
"""The value of an expression: a number, True or False, a string, a list or a pose."""


class Array(tuple[Any, ...]):
    """A list; arithmetic is element by element, and a change makes a new list."""

    __slots__ = ()

    def __getitem__(self, index: Datum) -> Datum:
        if isinstance(index, tuple):
            row, column = index
            return self[row][column]
        if isinstance(index, slice):  # none of the script's own
            return tuple.__getitem__(self, index)
        return tuple.__getitem__(self, place(self, index))

    def _each(self, other: Datum, apply: Callable[[Any, Any], Any]) -> Array:
        if isinstance(other, tuple):
            if len(other) != len(self):
                raise TypeError(f"lists of {len(self)} and {len(other)} elements")
            return Array(apply(a, b) for a, b in zip(self, other, strict=True))
        return Array(apply(a, other) for a in self)

    def __add__(self, other: Datum) -> Array:
        return self._each(other, operator.add)

    def __sub__(self, other: Datum) -> Array:
        return self._each(other, operator.sub)

    def __mul__(self, other: Datum) -> Array:
        return self._each(other, operator.mul)

    def __rmul__(self, other: Datum) -> Array:
        return self._each(other, operator.mul)

    def __truediv__(self, other: Datum) -> Array:
        return self._each(other, operator.truediv)

    def __neg__(self) -> Array:
        return self._each(-1, operator.mul)


class Pose(Array):
    """Six numbers: metres, and a rotation vector in radians."""

    __slots__ = ()

    def _each(self, other: Datum, apply: Callable[[Any, Any], Any]) -> Array:  # noqa: ARG002
        raise TypeError("poses have no arithmetic: use pose_add, pose_sub or pose_trans")


def pose_of(values: Iterable[float]) -> Pose:
    """Return a pose.

    Raises:
        TypeError: *values* are not six numbers.
    """
    pose = Pose(values)
    if len(pose) != 6:
        raise TypeError(f"a pose has 6 numbers, got {len(pose)}")
    return pose


def place(values: Datum, index: Datum) -> int:
    """Return *index* as a place in *values*.

    Raises:
        TypeError, IndexError: it is not a valid index.
    """
    if not isinstance(values, tuple):
        raise TypeError(f"{written(values)} is no list")
    if isinstance(index, bool) or index != int(index):
        raise TypeError(f"an index is an integer, got {written(index)}")
    if not 0 <= index < len(values):
        raise IndexError(f"index {int(index)} is outside a list of {len(values)} elements")
    return int(index)


def replaced(values: Datum, index: Datum, value: Datum) -> Datum:
    """Return a list with one element replaced; *index* is a number, or row and column."""
    if isinstance(index, tuple):
        return replaced(values, index[0], replaced(values[index[0]], index[1], value))
    at = place(values, index)
    return type(values)(value if number == at else one for number, one in enumerate(values))


def written(value: Datum) -> str:
    """Return a value as the controller prints it."""
    if isinstance(value, Pose):
        return f"p[{', '.join(map(written, value))}]"
    if isinstance(value, tuple):
        return f"[{', '.join(map(written, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
