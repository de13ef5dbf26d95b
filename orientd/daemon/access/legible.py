"""What the bytes of a request say, if anything.

gRPC reads a request before anybody can check who asks or how often, and answers bytes that say
nothing with a traceback in the log.  Here they become something that can be refused like any other
request.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from google.protobuf.message import DecodeError, Message


@dataclass(frozen=True)
class Illegible:
    """Bytes that are no request.

    Attributes:
        problem: what is wrong with them, in one line.
    """

    problem: str


Read = Callable[[bytes], Message]


def legible(read: Read | None) -> Callable[[bytes], Message | Illegible] | None:
    """Return *read*, made to return what it cannot read instead of raising.

    Args:
        read: makes a message of bytes; ``None`` where bytes are passed on as they are.
    """
    if read is None:
        return None

    def attempt(content: bytes) -> Message | Illegible:
        try:
            return read(content)
        except DecodeError as error:
            return Illegible(" ".join(str(error).split()))

    return attempt
