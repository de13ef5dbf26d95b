"""Plan smooth orientation motion for robots and stream it, cycle by cycle, to hardware."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from orientd.rpc.client import connect

__all__ = ["__version__", "connect"]

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the signature PEP 562 asks for
    # The servo process imports this package too and must not pay for gRPC and NumPy.
    if name == "connect":
        from orientd.rpc.client import connect

        return connect
    raise AttributeError(f"module 'orientd' has no attribute {name!r}")
