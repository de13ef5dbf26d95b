"""The start-up gate: the socket answers before what stands behind it is loaded.

Planner, curves and NumPy take longer to import than a health check should wait.  The server
starts with this gate in the place of the service, and calls that come early wait in front of it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import TYPE_CHECKING, Any

import grpc

if TYPE_CHECKING:
    # Generic for a type checker only.
    Interceptor = grpc.aio.ServerInterceptor[Any, Any]
    GenericHandler = grpc.GenericRpcHandler[Any, Any]
    MethodHandler = grpc.RpcMethodHandler[Any, Any]
else:
    Interceptor, GenericHandler = grpc.aio.ServerInterceptor, grpc.GenericRpcHandler


class StartupGate(Interceptor, GenericHandler):
    """Stand for one service: first closed, then for good open."""

    def __init__(self, service: str, wrap: Callable[[str, Any], Any]) -> None:
        """Stand for the service called *service*.

        Args:
            service: its full name.
            wrap: returns what handles a call in the place of its handler, by the call's name.
        """
        self._wrap = wrap
        self._prefix = f"/{service}/"
        self._handlers: dict[str, MethodHandler] = {}
        self._is_open = asyncio.Event()

    def open(self, register: Callable[[StartupGate], None]) -> None:
        """Let calls through from now on.

        Args:
            register: adds a service to this gate, as it would to a server.
        """
        register(self)
        self._is_open.set()

    def add_registered_method_handlers(
        self, service: str, handlers: Mapping[str, MethodHandler]
    ) -> None:
        """Take what generated code would add to a server."""
        self._handlers = {
            f"/{service}/{name}": self._wrap(name, inner) for name, inner in handlers.items()
        }

    def add_generic_rpc_handlers(self, handlers: object) -> None:
        """Leave out what generated code adds a second time."""

    async def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], Awaitable[Any]],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> Any:  # noqa: ANN401 - whatever handles the call
        """Hold calls of the service until the gate is open; others are none of its business."""
        if handler_call_details.method.startswith(self._prefix):
            await self._is_open.wait()
        return await continuation(handler_call_details)

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> MethodHandler | None:
        """Return what is behind the gate for a call."""
        return self._handlers.get(handler_call_details.method)
