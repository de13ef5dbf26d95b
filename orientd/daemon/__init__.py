"""The background service: devices, leases and plans, and the gRPC server in front of them.

Other packages import from ``calls.latency_identification``, ``log``, ``planners.reporting`` and
``server``.
"""
