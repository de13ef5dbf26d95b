"""The lease manager: who may command, and what becomes of their motions when that changes.

What was started under a lease stops when the lease is lost.  What was let go to be moved by hand
holds again when the lease runs out.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from orientd.daemon.leases.lease import Lease, LeaseTable
from orientd.daemon.motions import ActiveMotions
from orientd.errors import OrientdError, RequestError
from orientd.one_line import one_line

if TYPE_CHECKING:
    from orientd.daemon.device import Device

_log = logging.getLogger(__name__)


class LeaseManager:
    """The leases of a cell, with the motions that belong to them."""

    def __init__(
        self, leases: LeaseTable, runs: ActiveMotions, devices: Mapping[str, Device]
    ) -> None:
        """Let *leases* say who commands *devices*, and stop *runs* that have lost theirs."""
        self._leases = leases
        self._runs = runs
        self._devices = devices

    def acquire(
        self,
        holder: str,
        owner: str = "",
        *,
        name: str = "",
        devices: Collection[str] = (),
        beside: bool = False,
    ) -> Lease:
        """Give a lease of *devices* to *holder*; see :meth:`LeaseTable.acquire`.

        Raises:
            RequestError: the holder has no name.
            LeaseError: somebody else holds it.
        """
        holder = _holder(holder)
        self.expire()
        lease = self._leases.acquire(holder, owner, name=name, devices=devices, beside=beside)
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
        """Give a lease of *devices* to *holder* whoever has them; motions under those stop.

        Raises:
            RequestError: the holder has no name, or there is no reason.
        """
        holder, reason = _holder(holder), one_line(reason, 200)
        if not reason:
            raise RequestError("reason", "expected why the lease is seized, got nothing")
        before, lease = self._leases.seize(holder, owner, name=name, devices=devices)
        whose = ", ".join(one.who for one in before) or "nobody"
        _log.warning("lease: %s seizes it from %s: %s", lease.who, whose, reason)
        for one in before:
            self._disown(one, lease.devices, f"was seized by {lease.who}: {reason}")
        return lease

    def release(self, token: str) -> None:
        """Take the lease back; motions that were started with it stop.

        Raises:
            LeaseError: it is not held with *token*.
        """
        lease = self._leases.release(token)
        _log.info("lease: released by %s", lease.who)
        self._disown(lease, lease.devices, "was released")

    def expire(self) -> None:
        """Take leases back that have run out; motions that were started with them stop.

        Whoever let a device go to move it by hand is lost then: it is let go no longer.
        """
        for lease in self._leases.collect_expired():
            _log.warning("lease: that of %s has expired", lease.who)
            self._disown(lease, lease.devices, "has expired")
            for name in lease.devices:
                try:
                    self._devices[name].end_free()
                except OrientdError as error:
                    _log.warning("lease: %s was let go and does not hold again: %s", name, error)

    def _disown(self, lease: Lease, devices: Collection[str], what: str) -> None:
        for run in self._runs.unfinished(lease.token):
            if run.device.name in devices:
                self._runs.abandon(run, f"the lease of {lease.who} {what}")


def _holder(name: str) -> str:
    name = one_line(name, 200)
    if not name:
        raise RequestError("holder", "expected a name to tell others, got nothing")
    return name
