"""What docstrings say, for the cells and paragraphs of a page in Markdown."""

from __future__ import annotations

import inspect
import re

_ROLE = re.compile(r":[a-z:]+:`~?([^`<]+?)(?: <[^`>]+>)?`")


def said(text: str) -> str:
    """Return one paragraph of a docstring as Markdown, on one line."""
    text = _ROLE.sub(r"`\1`", " ".join(text.split()))
    return text.replace("``", "`").replace("|", "\\|")


def first(of: object, name: str) -> str:
    """Return the first paragraph of the docstring of *of*.

    Raises:
        ValueError: it has none; so the build fails.
    """
    text = inspect.getdoc(of)
    if not text:
        raise ValueError(f"{name} is public and has no docstring")
    return said(text.split("\n\n")[0])
