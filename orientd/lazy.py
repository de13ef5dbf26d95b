"""Fronts of packages, which load what they name when it is first asked for (PEP 562).

A front says once what others may use: by the imports that a type checker reads.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

_IMPORT = re.compile(r"^    from (orientd\S*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)


def lazily(package: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a front.

    Args:
        package: its name; below ``if TYPE_CHECKING:`` it imports what it offers.
    """
    front = sys.modules[package]
    source = front.__loader__.get_source(package)  # type: ignore[union-attr]
    home_of = {
        name.strip(): home
        for home, several, one in _IMPORT.findall(source)
        for name in (several or one).split(",")
        if name.strip()
    }
    front.__all__ = sorted(home_of)  # type: ignore[attr-defined]

    def find(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(import_module(home_of[name]), name)
        setattr(front, name, found)
        return found

    return find
