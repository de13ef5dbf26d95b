"""The leases of a client, each renewed until the client releases it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field

from orientd.client.connection import Connection
from orientd.errors import LeaseError, OrientdError
from orientd.protocol import control_pb2 as pb

RENEWALS = 3
"""Renewals within the duration of a lease."""

_RELEASE_TIMEOUT = 2.0
"""Timeout of a release, s."""


@dataclass
class _Held:
    """A lease: its token, its devices, and the error that cost it."""

    token: str
    devices: Sequence[str]
    ended: threading.Event = field(default_factory=threading.Event)
    lost: OrientdError | None = None


class Leases:
    """Hold leases, each renewed by its own thread."""

    def __init__(self, connection: Connection, *, holder: str, beside: bool = False) -> None:
        """Create it without a lease.

        Args:
            connection: to the daemon.
            holder: name shown to other clients.
            beside: whether to command together with other programs of the same user.
        """
        self.holder = holder
        self.beside = beside
        self._connection = connection
        self._taking = threading.RLock()  # held while the daemon answers; a look does not take it
        self._lock = threading.RLock()
        self._held: list[_Held] = []

    def token(self, device: str = "") -> str:
        """Return the token of the lease of *device*; empty if none is held.

        Without a device, return the token of the only held device.

        Raises:
            LeaseError: the lease was lost since it was last used.
        """
        with self._lock:
            held = self._find(device)
            if held is not None and held.lost is not None:
                self._held.remove(held)
                raise LeaseError(f"the lease was lost: {held.lost}") from held.lost
            return held.token if held is not None else ""

    def is_held(self, device: str = "") -> bool:
        """Return whether a lease of *device* is held."""
        with self._lock:
            held = self._find(device)
            return held is not None and held.lost is None

    def needed(self, device: str) -> str:
        """Return the token of the lease of *device*, after acquiring it if none is held.

        Raises:
            LeaseError: another client holds it, or it was lost since it was last used.
        """
        with self._taking:
            return self.token(device) or self.acquire([device]).token

    def acquire(self, devices: Sequence[str], *, beside: bool = False) -> pb.Lease:
        """Acquire one lease of *devices*, by default of every device of the daemon.

        Raises:
            LeaseError: another client holds one of them.
        """
        request = pb.AcquireLeaseRequest(
            holder=self.holder, devices=devices, beside=beside or self.beside
        )
        with self._taking:
            return self.keep(
                self._connection.ask(self._connection.stub.AcquireLease, request).lease
            )

    def seize(self, reason: str, devices: Sequence[str]) -> None:
        """Seize the lease of *devices* from its holder.

        Raises:
            AccessError: only administrators may do that.
        """
        request = pb.SeizeLeaseRequest(holder=self.holder, reason=reason, devices=devices)
        self.keep(self._connection.ask(self._connection.stub.SeizeLease, request).lease)

    def keep(self, lease: pb.Lease) -> pb.Lease:
        """Renew *lease* from now on, and use it for its devices."""
        held = _Held(lease.token, lease.devices)
        with self._lock:
            self._held.insert(0, held)
        interval = lease.seconds / RENEWALS
        renew = threading.Thread(target=self._renew, args=(held, interval), daemon=True)
        renew.name = "orientd lease"
        renew.start()
        return lease

    def release(self, devices: Sequence[str] = ()) -> None:
        """Release the leases of *devices*, by default all; the daemon need not know them.

        Raises:
            DaemonError: the daemon, or the servo of a motion that the release stops, does not
                answer.
        """
        with self._taking, self._lock:
            released = [
                held for held in self._held if not devices or set(devices) & set(held.devices)
            ]
            self._held = [held for held in self._held if held not in released]
        problem: OrientdError | None = None
        for held in released:
            held.ended.set()
            if held.lost is None:
                request = pb.ReleaseLeaseRequest(token=held.token)
                try:
                    self._connection.call(
                        self._connection.stub.ReleaseLease, request, timeout=_RELEASE_TIMEOUT
                    )
                except LeaseError:
                    pass  # it has ended
                except OrientdError as error:
                    problem = error
        if problem is not None:
            raise problem

    def _find(self, device: str) -> _Held | None:
        found = [held for held in self._held if not device or device in held.devices]
        is_clear = device or (len(found) == 1 and len(found[0].devices) == 1)
        return found[0] if found and is_clear else None

    def _renew(self, held: _Held, interval: float) -> None:
        request, failures = pb.RenewLeaseRequest(token=held.token), 0
        while not held.ended.wait(interval):
            try:
                self._connection.ask(self._connection.stub.RenewLease, request)
                failures = 0
            except OrientdError as error:
                failures += 1
                # A slow daemon may still answer in time.
                if isinstance(error, LeaseError) or failures == RENEWALS:
                    held.lost = error
                    return
