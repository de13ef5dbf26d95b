"""The lease: who may command the daemon, and for how long.

There is one lease for the whole daemon, not one for each device: two arms that work together then
have one commander, and "who is in control" has one answer.
"""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass, replace

from orientd.clock import Clock
from orientd.errors import LeaseError

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Lease:
    """The right to command.

    Attributes:
        token: secret of the holder; goes into every command.
        holder: who holds it, as they named themselves.
        expires_ns: when it ends unless it is renewed, monotonic clock.
        owner: whose it is, as the daemon knows them; empty where it knows nobody.
        is_offered: whether it was handed over to the owner, who has not taken it yet.
    """

    token: str
    holder: str
    expires_ns: int
    owner: str = ""
    is_offered: bool = False


class LeaseTable:
    """Hand out the lease to one holder at a time.  Safe to call from any thread."""

    def __init__(self, *, seconds: float, clock: Clock) -> None:
        """Open with nobody holding the lease.

        Args:
            seconds: how long a lease lasts from its acquisition or renewal, s.
            clock: tells when it has run out.
        """
        self.seconds = seconds
        self._span_ns = round(seconds * NANOSECONDS)
        self._clock = clock
        self._lock = threading.Lock()
        self._lease: Lease | None = None
        self._ended: Lease | None = None

    def current(self) -> Lease | None:
        """Return the lease if somebody holds it now."""
        with self._lock:
            return self._valid()

    @property
    def has_expired(self) -> bool:
        """Whether there is a lease for :meth:`collect_expired`."""
        with self._lock:
            return self._lease is not None and self._valid() is None

    def remaining(self, lease: Lease) -> float:
        """Return for how many seconds *lease* still lasts; never negative."""
        return max(0, lease.expires_ns - self._clock.now_ns()) / NANOSECONDS

    def owner(self, token: str) -> str | None:
        """Return whose the lease of *token* is; ``None`` if that is not the present one."""
        with self._lock:
            held = self._valid()
            return held.owner if held is not None and _is_same(held.token, token) else None

    def acquire(self, holder: str, owner: str = "") -> Lease:
        """Give the lease to *holder*, if it is free or was handed over to *owner*.

        Raises:
            LeaseError: somebody holds it; the message names them and the time that is left.
        """
        with self._lock:
            held = self._valid()
            if held is None:
                self._lease = self._new(holder, owner)
            elif held.is_offered and held.owner == owner:
                self._lease = replace(
                    held, holder=holder, is_offered=False, expires_ns=self._deadline()
                )
            else:
                raise LeaseError(self._taken(held))
            return self._lease

    def transfer(self, token: str, owner: str, name: str) -> tuple[Lease, Lease]:
        """Hand the lease over to *owner*, called *name*, who has its full time to acquire it.

        Returns:
            The lease before and after; the token of the former is worthless from now on.

        Raises:
            LeaseError: *token* is not that of the present holder.
        """
        with self._lock:
            held = self._check(token)
            self._ended = held
            self._lease = replace(self._new(name, owner), is_offered=True)
            return held, self._lease

    def seize(self, holder: str, owner: str) -> tuple[Lease | None, Lease]:
        """Give the lease to *holder* whoever has it.

        Returns:
            The lease before, if there was one, and the one now.
        """
        with self._lock:
            before = self._valid()
            if before is not None:
                self._ended = before
            self._lease = self._new(holder, owner)
            return before, self._lease

    def renew(self, token: str) -> Lease:
        """Let the lease of *token* last its full time from now.

        Raises:
            LeaseError: *token* is not that of the present holder.
        """
        with self._lock:
            held = self._check(token)
            self._lease = replace(held, expires_ns=self._deadline())
            return self._lease

    def release(self, token: str) -> Lease:
        """Take the lease back from its holder and return it as it was.

        Raises:
            LeaseError: *token* is not that of the present holder.
        """
        with self._lock:
            held = self._check(token)
            self._lease, self._ended = None, held
            return held

    def check(self, token: str) -> Lease:
        """Return the lease of *token*.

        Raises:
            LeaseError: *token* is not that of the present holder.
        """
        with self._lock:
            return self._check(token)

    def collect_expired(self) -> Lease | None:
        """Return the lease if it ran out since the last call, and forget it."""
        with self._lock:
            if self._lease is None or self._valid() is not None:
                return None
            self._ended, self._lease = self._lease, None
            return self._ended

    def _new(self, holder: str, owner: str) -> Lease:
        return Lease(secrets.token_hex(16), holder, self._deadline(), owner)

    def _deadline(self) -> int:
        return self._clock.now_ns() + self._span_ns

    def _valid(self) -> Lease | None:
        lease = self._lease
        return lease if lease is not None and self._clock.now_ns() < lease.expires_ns else None

    def _check(self, token: str) -> Lease:
        if not token:
            raise LeaseError("a command needs the lease: acquire it and send its token")
        held = self._valid()
        if held is not None and _is_same(held.token, token):
            return held
        if held is not None:
            raise LeaseError(self._taken(held))
        for ended in (self._lease, self._ended):
            if ended is not None and ended.token == token:
                raise LeaseError(
                    f"the lease of {ended.holder!r} has expired or was released: acquire it again"
                )
        raise LeaseError("this is not the token of any lease: acquire the lease first")

    def _taken(self, held: Lease) -> str:
        remaining = self.remaining(held)
        return f"the lease is held by {held.holder!r}, for another {remaining:.1f} s if not renewed"


def _is_same(token: str, other: str) -> bool:
    """Compare in a time that does not tell how much of it was right."""
    return secrets.compare_digest(token.encode(), other.encode())
