"""What a curve was made of: parameters by any of their names, kept for equality and pictures."""

from __future__ import annotations

from abc import ABCMeta
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from inspect import Signature, signature
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from orientd.curves.family_parameters import ordered_names, parameter_names
from orientd.rotation import unnamed

if TYPE_CHECKING:
    from orientd.curves.contract import Curve

Made = TypeVar("Made")

_AS_THEY_ARE = (float, int, str, bool, type(None))


class Family(ABCMeta):
    """The class of families of curves: it takes their parameters, and has each curve keep its own.

    Every orientation may be a ``scipy.spatial.transform.Rotation``, a
    :class:`~orientd.rotation.Quaternion` or an array ``(w, x, y, z)``, and every family takes
    ``keys``, ``times``, ``start_velocity``, ``end_velocity`` and ``turns`` besides the names of its
    own; :func:`orientd.curves.roles.own_names` says what these are to it.
    """

    def __call__(cls: type[Made], *args: Any, **given: Any) -> Made:  # noqa: ANN401
        """Make a curve."""
        for name, value in given.items():
            if not isinstance(value, np.ndarray) and type(value) not in _AS_THEY_ARE:
                given[name] = unnamed(value)
        family: type = cls
        if not given.keys() <= parameter_names(family):
            # Loads the kernels, which a list of the families has no need of.
            from orientd.curves.roles import own_names

            given = own_names(cast("type[Curve]", family), given)
        curve: Made = type.__call__(cls, *args, **given)
        if args:
            given.update(zip(ordered_names(family), args, strict=False))
        curve.made_of = {  # type: ignore[attr-defined]  # of every class of this one
            name: _kept(value) for name, value in given.items()
        }
        return curve

    @property
    def __signature__(cls) -> Signature:
        """The family's own parameters, which ``__call__`` would hide."""
        own = signature(cls.__init__)  # type: ignore[misc]  # that of the class at hand
        return own.replace(parameters=list(own.parameters.values())[1:])


def _kept(value: object) -> object:
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
