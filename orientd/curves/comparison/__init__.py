"""Every family on the same keyframes, and what each of them does in figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.curves.roles import own_names

__getattr__ = lazily(__name__)
