"""The requests of a call that comes by the gateway, as they come."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable


class Requests:
    """The requests of one call, serialised."""

    def __init__(self, *, taken: Callable[[], Awaitable[None]]) -> None:
        """Begin with none; tell *taken* of each that the handler has had."""
        self._taken = taken
        self._bodies: asyncio.Queue[bytes | None] = asyncio.Queue()
        self.waiting = 0
        """Bytes that the handler has not taken yet."""

    def add(self, body: bytes | None) -> None:
        """Add one; ``None`` after the last."""
        self.waiting += len(body or b"")
        self._bodies.put_nowait(body)

    def __aiter__(self) -> Requests:
        return self

    async def __anext__(self) -> bytes:
        body = await self._bodies.get()
        if body is None:
            raise StopAsyncIteration
        self.waiting -= len(body)
        await self._taken()
        return body
