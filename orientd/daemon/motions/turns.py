"""One motion of a device at a time is planned to be begun, in the order in which they came.

What a motion is planned from changes when another one begins: two that are planned side by side for
one device would each make the other come too late.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import defaultdict
from collections.abc import AsyncIterator

from orientd.daemon.planners import Order
from orientd.errors import DeadlineError


class Turns:
    """Whose motion is being planned and begun, for each device."""

    def __init__(self) -> None:
        self._locks: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    @contextlib.asynccontextmanager
    async def of(self, device: str, order: Order) -> AsyncIterator[None]:
        """Wait until it is the turn of *order*, and keep the turn for as long as the context lasts.

        Raises:
            DeadlineError: what was asked for before takes too long.
        """
        lock = self._locks[device]
        try:
            async with asyncio.timeout(order.time_left):
                await lock.acquire()
        except TimeoutError:
            raise DeadlineError(
                f"planning did not begin within {order.timeout:g} s: device {device} is being "
                "given motions that were asked for before"
            ) from None
        try:
            yield
        finally:
            lock.release()
