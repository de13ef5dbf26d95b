"""Requests whose motion is too large for one message, put together from pieces.

A message is kept whole in memory before anybody may look at it, so what one may be is small.  What
comes in pieces is counted as it comes: how much of one connection, how much of all together, and
how long it takes are bounded.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from typing import Any

from orientd.errors import DeadlineError, RequestError, TooMuchError

TOGETHER = 2
"""How many of the largest requests may come in at one time."""


class LargeRequests:
    """Puts requests together, and counts the bytes that are on their way."""

    def __init__(self, most_bytes: int) -> None:
        """Take motions of at most *most_bytes*."""
        self.most_bytes = most_bytes
        self._bytes: Counter[str] = Counter()

    async def gather(self, messages: AsyncIterator[Any], caller: str, timeout: float) -> Any:  # noqa: ANN401
        """Return the request that *messages* begin with, with its motion as the bytes of the rest.

        Args:
            messages: each with a ``request``, the first, or with a ``piece`` of its motion.
            caller: whose they are.
            timeout: how long they may take, s.

        Raises:
            RequestError: they come in another order, or are too large.
            TooMuchError: too much comes in already.
            DeadlineError: they take too long.
        """
        taken = 0
        pieces, request = [], None
        try:
            async with asyncio.timeout(timeout):
                async for message in messages:
                    if (request is None) != (message.WhichOneof("part") == "request"):
                        raise RequestError("request", "expected it once, before any piece")
                    if request is None:
                        request = message.request
                        continue
                    pieces.append(message.piece)
                    taken += len(message.piece)
                    if taken > self.most_bytes:
                        problem = f"expected at most {self.most_bytes} bytes, got more"
                        raise RequestError("motion", problem)
                    self._bytes[caller] += len(message.piece)
                    self._check(caller)
        except TimeoutError as error:
            raise DeadlineError(f"the request took more than {timeout:g} s to come in") from error
        finally:
            self._bytes[caller] -= min(taken, self._bytes[caller])
            if not self._bytes[caller]:
                del self._bytes[caller]
        if request is None:
            raise RequestError("request", "expected a request, got nothing")
        if pieces:
            request.motion = b"".join(pieces)
        return request

    def _check(self, caller: str) -> None:
        if (
            self._bytes[caller] > self.most_bytes
            or self._bytes.total() > TOGETHER * self.most_bytes
        ):
            raise TooMuchError("too many large requests come in at the same time: try again")
