"""Timing of a path: times for keyframes, and the fastest profile within the limits.

Other packages import from ``axes``, ``axis_turn``, ``axis_ways``, ``even``, ``keyframe_path``,
``knots`` and ``profiles``.
"""
