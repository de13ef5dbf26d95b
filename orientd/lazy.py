"""Packages that offer names to programs and load each when it is first asked for (PEP 562)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any


def lazily(package: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package that offers the names below ``if TYPE_CHECKING:``.

    A type checker reads the imports there, and Python does not run them.  This looks up in them
    which module has a name, and loads that module alone.
    """
    front = sys.modules[package]

    @cache
    def homes() -> dict[str, str]:
        import ast  # a stop from the shell waits for this module
        from pathlib import Path

        tree = ast.parse(Path(str(front.__file__)).read_text(encoding="utf-8"))
        blocks = (block.body for block in tree.body if isinstance(block, ast.If))
        imports = [one for body in blocks for one in body if isinstance(one, ast.ImportFrom)]
        return {alias.name: str(one.module) for one in imports for alias in one.names}

    def find(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name == "__all__":
            return sorted(homes())
        if name not in homes():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(import_module(homes()[name]), name)
        setattr(front, name, found)
        return found

    return find
