"""The background service: devices, leases and plans, and the gRPC server in front of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.calls.latency_identification import measure_latency
    from orientd.daemon.log import LogFormat, set_up_log
    from orientd.daemon.planners.reporting import known_methods, plan_of, samples_of
    from orientd.daemon.server import run

__getattr__ = lazily(
    __name__,
    {
        "orientd.daemon.calls.latency_identification": ("measure_latency",),
        "orientd.daemon.log": (
            "LogFormat",
            "set_up_log",
        ),
        "orientd.daemon.planners.reporting": (
            "known_methods",
            "plan_of",
            "samples_of",
        ),
        "orientd.daemon.server": ("run",),
    },
)
