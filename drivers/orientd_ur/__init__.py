"""A driver for Universal Robots arms over `ur-rtde`."""
