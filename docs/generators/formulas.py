"""MathJax served from the site itself, so that formulas are drawn without a network."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sphinx.errors import ExtensionError
from sphinx.util.fileutil import copy_asset

# What brings it is an extension of Sphinx by itself, which does not permit building in parallel.
_BRINGS = "sphinx-mathjax-offline"
_NEEDED = ("tex-chtml.js", "output/chtml")


def copy(app: Any, error: Exception | None) -> None:  # noqa: ANN401 - Sphinx's application
    """Copy what pages need of MathJax into a site that was built."""
    if error is not None or app.builder.format != "html":
        return
    found = find_spec(_BRINGS)
    if found is None or found.origin is None:
        raise ExtensionError(f"formulas need {_BRINGS}; it is in the extra `docs`")
    source = Path(found.origin).parent / "static" / "mathjax"
    for name in _NEEDED:
        target = Path(app.outdir) / "_static" / "mathjax" / name
        copy_asset(source / name, target if (source / name).is_dir() else target.parent)
