"""The calls of the gRPC service ``orientd.v1.Control``, by subject: messages in, messages out.

Other packages import from ``service`` and ``telemetry``.
"""
