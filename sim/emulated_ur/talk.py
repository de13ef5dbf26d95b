"""What a client and the controller say to each other on one port; no sockets here."""

from __future__ import annotations

from emulated_ur.controller import Event


class Talk:
    """One client's conversation; this one says nothing.

    Attributes:
        greeting: what the client is told when it has connected.
    """

    greeting = b""

    def feed(self, chunk: bytes) -> bytes:  # noqa: ARG002
        """Take what the client says; return the answer."""
        return b""

    def tick(self) -> bytes:
        """Return what the client is told in this tick."""
        return b""

    def tell(self, event: Event) -> bytes:  # noqa: ARG002
        """Return what the client is told of an event."""
        return b""

    def close(self) -> None:
        """Take note that the client has gone."""
