"""Read recordings of other programs as orientations over time, and replay them.

MCAP files with poses, ROS 2 bags, tables and trajectories in text.

For other programs: ``orientations``.
"""
