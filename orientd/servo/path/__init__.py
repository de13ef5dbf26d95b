"""Follow the path and stop on it: time scaling, feasible rates, quick stop, cones ahead.

Other packages import from ``path_follower``, ``quick_stop``, ``segment`` and
``time_scaling``.
"""
