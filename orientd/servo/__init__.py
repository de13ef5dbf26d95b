"""The servo process: one device, one thread, one cycle after another.

Other packages import from ``keep_out_cones``, ``path.path_follower``, ``path.segment``,
``path.time_scaling``, ``process``, ``realtime``, ``servo``, ``tracking.chunks``,
``tracking.target_follower`` and ``watchdog``.
"""
