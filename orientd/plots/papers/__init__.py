"""The figures of the papers, made anew, and what is only for them: bodies along a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.plots.papers.scenes import plate
    from orientd.plots.papers.sweep import SweptPoses, draw_bodies

__getattr__ = lazily(__name__)
