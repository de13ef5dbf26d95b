"""Wait for a device: for its rest, where a motion can begin from rest only, or a steady speed."""

from __future__ import annotations

import asyncio
import math
import time

from orientd.daemon.devices import ServoLink
from orientd.errors import StateError
from orientd.stream import Command, ServoState

LONGEST_STOP = 30.0
"""How long a stop on the path may take, s."""


async def stop_on_path(link: ServoLink, period: float) -> None:
    """Have what runs stop on its path, and wait for that.

    Args:
        link: to the servo.
        period: of the device, s.

    Raises:
        StateError: it does not come to rest.
    """
    cycle = link.newest()
    if cycle is not None and cycle.state is ServoState.STREAMING:
        await asyncio.to_thread(link.ask, Command.STOP)
    await await_rest(link, period)


async def await_rest(link: ServoLink, period: float) -> None:
    """Wait until a stop has come to its end; arguments and errors as of :func:`stop_on_path`."""
    end = time.monotonic() + LONGEST_STOP
    while time.monotonic() < end:
        cycle = link.newest()
        if cycle is None or cycle.state not in (ServoState.STREAMING, ServoState.STOPPING):
            return
        await asyncio.sleep(period)
    raise StateError("the device does not come to rest")


async def await_steady(link: ServoLink, period: float) -> None:
    """Wait while the speed along the path is changing; arguments and errors as above."""
    end = time.monotonic() + LONGEST_STOP
    index, speed = -1, math.nan
    while time.monotonic() < end:
        cycle = link.newest()
        if cycle is None or cycle.state is not ServoState.STREAMING:
            return
        if cycle.index > index:
            if cycle.speed == speed:
                return
            index, speed = cycle.index, cycle.speed
        await asyncio.sleep(period)
    raise StateError("the device does not come to a steady speed")
