"""Fronts of packages that load what they offer when it is first asked for (PEP 562)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def lazily(package: str, offered: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a front.

    Args:
        package: its name.
        offered: modules with the names that the front offers of each.  A type checker reads the
            same from imports below ``if TYPE_CHECKING:``; ``tests/structure.py`` compares them.
    """
    front = sys.modules[package]
    home_of = {name: home for home, names in offered.items() for name in names}
    front.__all__ = sorted(home_of)  # type: ignore[attr-defined]

    def find(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(import_module(home_of[name]), name)
        setattr(front, name, found)
        return found

    return find
