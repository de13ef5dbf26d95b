"""Reproduce the figures of the papers, with bodies drawn along a motion."""

from __future__ import annotations

from orientd.plots.papers.scenes import plate
from orientd.plots.papers.sweep import SweptPoses, draw_bodies
