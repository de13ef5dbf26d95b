"""How a call is done: away from the event loop, in its turn, and over when the daemon ends.

What a call is refused for is raised as an :class:`~orientd.errors.OrientdError`.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import defaultdict
from collections.abc import Callable

from orientd.daemon.cell import Cell
from orientd.errors import RequestError
from orientd.rpc import control_pb2 as pb

DEFAULT_REPORTS_HZ = 20.0
SLOWEST_REPORTS_HZ = 0.1
FASTEST_REPORTS_HZ = 100.0

OVERTAKING = 0.05
"""How long a command waits for those before it that are still on their way, s."""
_OVERTAKEN = 0.001  # s between looks


class Calls:
    """What the calls of every subject have in common: the cell, and who works for them."""

    def __init__(self, cell: Cell, describe: Callable[[], pb.DaemonReport]) -> None:
        """Serve *cell*.

        Args:
            cell: devices, lease and motions.
            describe: says what there is to say about the daemon itself.
        """
        self._cell = cell
        self._describe = describe
        self._closing = asyncio.Event()
        self._turns: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    def end_calls(self) -> None:
        """Let every WatchState come to its end."""
        self._closing.set()

    async def _is_closing_within(self, seconds: float) -> bool:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._closing.wait()
        return self._closing.is_set()

    async def _is_woken(self, wake: asyncio.Event) -> bool:
        """Wait for *wake*; return whether it came before the daemon's end."""
        waiting = [asyncio.ensure_future(event.wait()) for event in (wake, self._closing)]
        try:
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for one in waiting:
                one.cancel()
        wake.clear()
        return not self._closing.is_set()

    async def _in_turn(self, token: str, device: str, number: int) -> asyncio.Lock:
        """Wait a moment for commands that were begun before this one and are on their way.

        What threads of one client begin together may arrive in another order, and an old command
        is refused.

        Returns:
            What is held while the command is done and its answer is made.
        """
        end, name = time.monotonic() + OVERTAKING, self._cell.device(device).name
        while self._cell.leases.is_ahead(token, name, number) and time.monotonic() < end:
            await asyncio.sleep(_OVERTAKEN)
        return self._turns[name]


def interval(field: str, rate_hz: float) -> float:
    """Return the seconds between reports, of which *rate_hz* are wanted; 0 is the default."""
    if rate_hz == 0.0:
        return 1.0 / DEFAULT_REPORTS_HZ
    if not SLOWEST_REPORTS_HZ <= rate_hz <= FASTEST_REPORTS_HZ:
        raise RequestError(
            field, f"expected {SLOWEST_REPORTS_HZ:g} to {FASTEST_REPORTS_HZ:g}, got {rate_hz:g}"
        )
    return 1.0 / rate_hz
