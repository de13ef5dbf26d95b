"""The names of the parameters that a family of curves takes."""

from __future__ import annotations

from functools import lru_cache
from inspect import signature


@lru_cache(maxsize=256)
def ordered_names(family: type) -> tuple[str, ...]:
    """Return the names of the parameters of a family, in their order."""
    return tuple(signature(family).parameters)


@lru_cache(maxsize=256)
def parameter_names(family: type) -> frozenset[str]:
    """Return the names of the parameters of a family."""
    return frozenset(ordered_names(family))
