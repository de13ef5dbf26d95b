"""What the bytes of a request say, if anything.

gRPC reads a request before anybody can check who asks or how often, and answers bytes that say
nothing with a traceback in the log.  Here they become an error, which is refused like any other
request.
"""

from __future__ import annotations

from collections.abc import Callable

from google.protobuf.message import DecodeError, Message

from orientd.errors import RequestError

Read = Callable[[bytes], Message]


def legible(read: Read | None) -> Callable[[bytes], Message | RequestError] | None:
    """Return *read*, made to return what is wrong, in one line, instead of raising it.

    Args:
        read: makes a message of bytes; ``None`` where bytes are passed on as they are.
    """
    if read is None:
        return None

    def attempt(content: bytes) -> Message | RequestError:
        try:
            return read(content)
        except DecodeError as error:
            problem = " ".join(str(error).split())
            return RequestError("", f"the request cannot be read: {problem}")

    return attempt
