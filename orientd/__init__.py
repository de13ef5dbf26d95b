"""Plan smooth orientation motion for robots and stream it, cycle by cycle, to hardware."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from orientd.rpc.client import connect
    from orientd.rpc.motion_request import Quaternion
    from orientd.rpc.reports import OnTarget

__all__ = ["OnTarget", "Quaternion", "__version__", "connect"]

__version__ = "0.1.0"

# The servo process imports this package too and must not pay for gRPC and NumPy.
_HOMES = {
    "connect": "orientd.rpc.client",
    "OnTarget": "orientd.rpc.reports",
    "Quaternion": "orientd.rpc.motion_request",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the signature PEP 562 asks for
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'orientd' has no attribute {name!r}")
