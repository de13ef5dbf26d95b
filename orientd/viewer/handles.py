"""Handles of what is on the page."""

from __future__ import annotations

from typing import Any


def set_changed(handle: Any, **properties: object) -> None:  # noqa: ANN401 - the library's own
    """Set what has changed: every setting is sent to every page."""
    for name, value in properties.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
