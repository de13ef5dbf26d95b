"""The calls of the gRPC service ``orientd.v1.Control``, by subject: messages in, messages out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.calls.service import Service
    from orientd.daemon.calls.telemetry import Telemetry

__getattr__ = lazily(
    __name__,
    {
        "orientd.daemon.calls.service": ("Service",),
        "orientd.daemon.calls.telemetry": ("Telemetry",),
    },
)
