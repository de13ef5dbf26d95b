"""The figures of the papers, made anew, and what is only for them: bodies along a motion."""

from __future__ import annotations

from orientd.plots.papers.scenes import plate
from orientd.plots.papers.sweep import SweptPoses, draw_bodies
