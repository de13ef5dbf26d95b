"""The leases of a client: those of the devices that it commands, taken, kept, given back."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Collection
from typing import Any

from orientd.rpc import control_pb2 as pb
from orientd.rpc.connection import Connection
from orientd.rpc.lease_keeper import LeaseKeeper

_RELEASE_TIMEOUT = 2.0
"""How long the daemon may take to hear that a lease is given back, s."""


class LeaseHolder:
    """A client of the daemon that holds the leases of the devices it commands.

    Attributes:
        holder: what others are told when they are refused because of it.
    """

    def __init__(self, connection: Connection, *, holder: str, beside: bool = False) -> None:
        """Hold nothing until the first command over *connection*.

        Args:
            connection: to the daemon.
            holder: what others are told.
            beside: whether to command beside other programs of the same user, on purpose.
        """
        self.holder = holder
        self._connection = connection
        self._stub = connection.stub
        self._beside = beside
        self._lock = threading.Lock()
        self._keepers: list[LeaseKeeper] = []
        self._numbers: Counter[tuple[str, str]] = Counter()
        self._names: tuple[str, ...] = ()

    @property
    def lease_token(self) -> str:
        """The token of the first lease that is held; empty before the first command."""
        return next((keeper.token() for keeper in self._keepers if keeper.is_held), "")

    def holds_lease(self, device: str = "") -> bool:
        """Whether a lease of *device* is held."""
        name = self.device_name(device)
        return any(keeper.is_held and keeper.covers(name) for keeper in self._keepers)

    def acquire_lease(self, *devices: str, beside: bool = False) -> None:
        """Take the lease of *devices* now, rather than with the first command to each.

        Args:
            devices: all of them, or none; every device of the daemon where none are named.
            beside: whether to command beside other programs of the same user, which keep their
                leases.  What one gives back, or loses, ends its own motions alone.

        Raises:
            LeaseError: somebody else holds one of them.
        """
        names = [self.device_name(device) for device in devices or self._names]
        missing = [name for name in names if not self.holds_lease(name)]
        if missing or not names:
            self._keep(self._keeper(missing, beside=beside))

    def release_lease(self) -> None:
        """Give the leases back now, rather than at the end; what runs under them is stopped."""
        with self._lock:
            keepers, self._keepers = self._keepers, []
        for keeper in keepers:
            keeper.release()

    def seize_lease(self, reason: str, *devices: str) -> None:
        """Take the lease whoever holds it; motions that run under it are stopped.

        Args:
            reason: why; it is recorded, and told to whoever runs a motion.
            devices: of which; every device of the daemon where none are named.

        Raises:
            AccessError: that is for administrators.
        """
        request = pb.SeizeLeaseRequest(holder=self.holder, reason=reason, devices=devices)
        keeper = self._keeper(devices)
        keeper.hold(self._connection.ask(self._stub.SeizeLease, request).lease)
        self._keep(keeper)

    def device_name(self, device: str) -> str:
        """Return the name of *device*, where an empty one is that of the only one there is."""
        return self._names[0] if not device and len(self._names) == 1 else device

    def _command_of(self, device: str, begin: Callable[[str, int], Any]) -> Any:  # noqa: ANN401
        """Begin a command to *device* under its lease, and return what *begin* does.

        Commands are begun in the order of their numbers, whichever threads they come from.

        Args:
            device: what is commanded.
            begin: is told the token, and the number of the command under it.

        Raises:
            LeaseError: somebody else holds the lease.
        """
        name = self.device_name(device)
        token = self._keeper_of(name).token()
        with self._lock:
            self._numbers[token, name] += 1
            return begin(token, self._numbers[token, name])

    def _keeper_of(self, name: str) -> LeaseKeeper:
        with self._lock:
            for keeper in self._keepers:
                if keeper.covers(name):
                    return keeper
            keeper = self._keeper((name,))
            self._keepers.append(keeper)
            return keeper

    def _keep(self, keeper: LeaseKeeper) -> None:
        """Have *keeper* take its lease, if it is not held, and keep it for its devices."""
        keeper.token()
        with self._lock:
            self._keepers.insert(0, keeper)  # before one that was refused

    def _keeper(self, devices: Collection[str], *, beside: bool = False) -> LeaseKeeper:
        def acquire() -> pb.Lease:
            request = pb.AcquireLeaseRequest(
                holder=self.holder, devices=devices, beside=beside or self._beside
            )
            lease: pb.Lease = self._connection.ask(self._stub.AcquireLease, request).lease
            return lease

        return LeaseKeeper(
            acquire=acquire, renew=self._renew, release=self._release, devices=devices
        )

    def _renew(self, token: str) -> None:
        self._connection.ask(self._stub.RenewLease, pb.RenewLeaseRequest(token=token))

    def _release(self, token: str) -> None:
        request = pb.ReleaseLeaseRequest(token=token)
        self._connection.call(self._stub.ReleaseLease, request, timeout=_RELEASE_TIMEOUT)
