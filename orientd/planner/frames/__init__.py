"""Base and tool frames, in which requests are given and reports are made."""

from __future__ import annotations

from orientd.planner.frames.frame import Frame, Pose, named_frames
