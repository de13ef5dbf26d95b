"""The servo process: one device, one thread, one cycle after another.

Other packages import from ``keep_out_cones``, ``path.segment``, ``path.time_scaling``, ``process``,
``realtime``, ``servo``, ``settings``, ``tracking.chunk_report``, ``tracking.chunks`` and
``watchdog``.
"""
