"""Leases: who may command which device, and for how long.

A lease is of one device or of several, and a device is in the leases of one identity alone.  Two
programs of one identity share a device only if the second one asks for that.  Then each has a lease
of its own: if one of them returns or loses its lease, the other lease and its motions continue.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from orientd.clock import Clock
from orientd.errors import LeaseError, RequestError, TooMuchError
from orientd.one_line import one_line

_log = logging.getLogger(__name__)

NANOSECONDS = 1_000_000_000

MOST_LEASES = 128
"""Leases of one owner at a time: every look at the leases goes through all of them."""


@dataclass(frozen=True)
class Lease:
    """The right to command devices.

    Attributes:
        token: secret of the holder; goes into every command.
        holder: what holds it, as it named itself.
        expires_ns: when it ends unless it is renewed, monotonic clock.
        devices: which may be commanded with it, in the order of the table.
        owner: key of the holder's identity; empty if the daemon does not know it.
        name: readable name of the owner.
    """

    token: str
    holder: str
    expires_ns: int
    devices: tuple[str, ...] = ()
    owner: str = ""
    name: str = ""

    @property
    def who(self) -> str:
        """Return the owner if the daemon has checked it, otherwise the holder's own name."""
        return f"{self.name} ({self.owner})" if self.owner and self.name else repr(self.holder)


EXPIRED = "has expired"
"""Text for a lease that its holder did not renew."""

Lost = Callable[[Lease, Collection[str], str], object]
"""Is called when a lease is lost: with the lease, its devices, and the reason.  Returns at once."""


class Leases:
    """Hand out leases, each device to one identity at a time.  Safe to call from any thread."""

    def __init__(self, devices: Sequence[str], *, seconds: float, clock: Clock, lost: Lost) -> None:
        """Start without any lease.

        Args:
            devices: names of all devices.
            seconds: how long a lease lasts from its acquisition or renewal, s.
            clock: times the leases.
            lost: stops the motions of a lost lease.
        """
        self.seconds = seconds
        self._lost = lost
        self._devices = tuple(devices)
        self._span_ns = round(seconds * NANOSECONDS)
        self._clock = clock
        self._lock = threading.Lock()
        self._leases: dict[str, Lease] = {}

    def held(self) -> list[Lease]:
        """Return the leases that are held now, in the order in which they were taken."""
        with self._lock:
            return list(self._valid())

    @property
    def has_expired(self) -> bool:
        """Whether there is a lease for :meth:`expire`."""
        with self._lock:
            return len(list(self._valid())) < len(self._leases)

    def remaining(self, lease: Lease) -> float:
        """Return for how many seconds *lease*, as last renewed, still lasts; never negative."""
        newest = self._leases.get(lease.token, lease)
        return max(0, newest.expires_ns - self._clock.now_ns()) / NANOSECONDS

    def acquire(
        self,
        holder: str,
        owner: str = "",
        *,
        name: str = "",
        devices: Collection[str] = (),
        beside: bool = False,
    ) -> Lease:
        """Give a lease of *devices* to *holder*, of all of them or of none.

        Args:
            holder: what it calls itself.
            owner: whose it will be.
            name: of the owner, for people.
            devices: which; all there are if empty.
            beside: whether to share the devices with other leases of the same owner.

        Raises:
            RequestError: the holder has no name.
            LeaseError: one of the devices is taken; the message names the holder and the time that
                is left.
            TooMuchError: the owner has too many leases.
        """
        holder = _named(holder)
        self.expire()
        with self._lock:
            if sum(held.owner == owner for held in self._valid()) >= MOST_LEASES:
                raise TooMuchError(f"at most {MOST_LEASES} leases of one user at the same time")
            wanted = self._in_order(devices)
            for held in self._valid():
                is_own = held.owner == owner
                if set(wanted) & set(held.devices) and not (beside and is_own):
                    advice = "; with --lease, this commands beside it" if is_own else ""
                    raise LeaseError(self._taken(held) + advice)
            lease = self._new(holder, owner, name, wanted)
        _log.info("lease: acquired by %s%s", lease.who, ", beside others" if beside else "")
        return lease

    def seize(
        self,
        holder: str,
        owner: str,
        reason: str,
        *,
        name: str = "",
        devices: Collection[str] = (),
    ) -> Lease:
        """Give *holder* a lease of *devices* (all if empty), even if others hold them.

        Raises:
            RequestError: the holder has no name, or there is no reason.
        """
        holder, reason = _named(holder), one_line(reason, 200)
        if not reason:
            raise RequestError("reason", "expected why the lease is seized, got nothing")
        with self._lock:
            wanted = self._in_order(devices)
            before = self._take_away(wanted)
            lease = self._new(holder, owner, name, wanted)
        whose = ", ".join(one.who for one in before) or "nobody"
        _log.warning("lease: %s seizes it from %s: %s", lease.who, whose, reason)
        for one in before:
            self._lost(one, wanted, f"was seized by {lease.who}: {reason}")
        return lease

    def renew(self, token: str, owner: str | None = None) -> Lease:
        """Let the lease of *token*, and of *owner* if one is given, last its full time from now.

        Raises:
            LeaseError: there is no such lease.
        """
        with self._lock:
            lease = replace(
                self._check(token, owner=owner), expires_ns=self._clock.now_ns() + self._span_ns
            )
            self._leases[lease.token] = lease
            return lease

    def release(self, token: str, owner: str | None = None) -> Lease:
        """Take the lease of *token*, and of *owner* if one is given, back from its holder.

        Returns:
            The lease as it was.

        Raises:
            LeaseError: there is no such lease.
        """
        with self._lock:
            lease = self._check(token, owner=owner)
            del self._leases[lease.token]
        _log.info("lease: released by %s", lease.who)
        self._lost(lease, lease.devices, "was released")
        return lease

    def expire(self) -> None:
        """Take leases back that have run out."""
        with self._lock:
            valid = {lease.token for lease in self._valid()}
            expired = [lease for token, lease in self._leases.items() if token not in valid]
            for lease in expired:
                del self._leases[lease.token]
        for lease in expired:
            _log.warning("lease: that of %s has expired", lease.who)
            self._lost(lease, lease.devices, EXPIRED)

    def check(self, token: str, device: str = "", owner: str | None = None) -> Lease:
        """Return the lease of *token*.

        Args:
            token: secret of its holder.
            device: that it must be of; empty for any.
            owner: key that its owner must have; ``None`` for any owner.

        Raises:
            LeaseError: there is no such lease.
        """
        with self._lock:
            return self._check(token, device, owner)

    def is_valid(self, token: str, device: str) -> bool:
        """Return whether there is a lease of *device* with this *token*."""
        return any(lease.token == token and device in lease.devices for lease in self.held())

    # With the lock held

    def _new(self, holder: str, owner: str, name: str, devices: tuple[str, ...]) -> Lease:
        lease = Lease(
            secrets.token_hex(16),
            holder,
            self._clock.now_ns() + self._span_ns,
            devices,
            owner,
            name,
        )
        self._leases[lease.token] = lease
        return lease

    def _take_away(self, devices: Collection[str]) -> list[Lease]:
        """Take *devices* out of every lease; return those that had any, as they were."""
        before = [lease for lease in self._valid() if set(devices) & set(lease.devices)]
        for lease in before:
            left = tuple(name for name in lease.devices if name not in devices)
            if left:
                self._leases[lease.token] = replace(lease, devices=left)
            else:
                del self._leases[lease.token]
        return before

    def _in_order(self, devices: Collection[str]) -> tuple[str, ...]:
        return tuple(name for name in self._devices if not devices or name in devices)

    def _valid(self) -> Iterator[Lease]:
        now = self._clock.now_ns()
        return (lease for lease in self._leases.values() if now < lease.expires_ns)

    def _check(self, token: str, device: str = "", owner: str | None = None) -> Lease:
        if not token:
            raise LeaseError("a command needs the lease: acquire it and send its token")
        given = token.encode()
        # In a time that does not tell how much of a token was right.
        found = (one for one in self._valid() if secrets.compare_digest(one.token.encode(), given))
        lease = next(found, None)
        if lease is not None and owner is not None and lease.owner != owner:
            problem = f"the lease is held by {lease.owner}, its token is of no use to {owner}"
            raise LeaseError(problem)
        if lease is not None and (not device or device in lease.devices):
            return lease
        names = {device} if device else set(self._devices)
        for held in self._valid():
            if names & set(held.devices):
                raise LeaseError(self._taken(held))
        if lease is not None:
            raise LeaseError(f"the lease covers {_listed(lease)}, not {device}: acquire that too")
        raise LeaseError("the lease of this token has expired or was released: acquire it again")

    def _taken(self, held: Lease) -> str:
        of = f" of {_listed(held)}" if len(self._devices) > 1 else ""
        whose = f"{held.holder!r} ({held.owner})" if held.owner else repr(held.holder)
        remaining = self.remaining(held)
        return f"the lease{of} is held by {whose}, for another {remaining:.1f} s if not renewed"


def _listed(lease: Lease) -> str:
    return ", ".join(lease.devices)


def _named(holder: str) -> str:
    name = one_line(holder, 200)
    if not name:
        raise RequestError("holder", "expected a name that other clients see, got nothing")
    return name
