"""The lease manager: who may command, and what becomes of their motions when that changes.

What was started under a lease stops when the lease is lost, and goes on when it is handed over.
"""

from __future__ import annotations

import logging

from orientd.daemon.leases.lease import Lease, LeaseTable
from orientd.daemon.motions import ActiveMotions
from orientd.errors import RequestError

_log = logging.getLogger(__name__)


class LeaseManager:
    """The lease of a cell, with the motions that belong to it."""

    def __init__(self, leases: LeaseTable, runs: ActiveMotions) -> None:
        """Let *desk* say who holds the lease, and stop *runs* that have lost theirs."""
        self._leases = leases
        self._runs = runs

    def acquire(self, holder: str, owner: str = "") -> Lease:
        """Give the lease to *holder*, who is *owner*, if it is free or was handed over to them.

        Raises:
            RequestError: the holder has no name.
            LeaseError: somebody else holds it.
        """
        holder = _holder(holder)
        self.expire()
        lease = self._leases.acquire(holder, owner)
        _log.info("lease: acquired by %r", holder)
        return lease

    def transfer(self, token: str, owner: str, name: str) -> Lease:
        """Hand the lease, and the motions under it, over to *owner*, called *name*.

        Raises:
            LeaseError: it is not held with *token*.
        """
        before, lease = self._leases.transfer(token, owner, name)
        self._runs.reassign(before.token, lease.token)
        _log.info("lease: %r hands it over to %r", before.holder, name)
        return lease

    def seize(self, holder: str, owner: str, reason: str) -> Lease:
        """Give the lease to *holder* whoever has it; a motion that was started with it stops.

        Raises:
            RequestError: the holder has no name, or there is no reason.
        """
        holder, reason = _holder(holder), " ".join(reason.split())[:200]
        if not reason:
            raise RequestError("reason", "expected why the lease is seized, got nothing")
        before, lease = self._leases.seize(holder, owner)
        whose = "nobody" if before is None else repr(before.holder)
        _log.warning("lease: %r seizes it from %s: %s", holder, whose, reason)
        if before is not None:
            self._disown(before, f"was seized by {holder}: {reason}")
        return lease

    def release(self, token: str) -> None:
        """Take the lease back; a motion that was started with it stops.

        Raises:
            LeaseError: it is not held with *token*.
        """
        lease = self._leases.release(token)
        _log.info("lease: released by %r", lease.holder)
        self._disown(lease, "was released")

    def expire(self) -> None:
        """Take the lease back if it has run out; a motion that was started with it stops."""
        lease = self._leases.collect_expired()
        if lease is not None:
            _log.warning("lease: that of %r has expired", lease.holder)
            self._disown(lease, "has expired")

    def _disown(self, lease: Lease, what: str) -> None:
        owned = [run.device for run in self._runs.unfinished(lease.token)]
        self._runs.halt(owned, f"the lease of {lease.holder!r} {what}")


def _holder(name: str) -> str:
    name = " ".join(name.split())[:200]
    if not name:
        raise RequestError("holder", "expected a name to tell others, got nothing")
    return name
