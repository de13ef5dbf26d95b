"""The lease of a client: taken by its first command, kept, lent, handed over, given back."""

from __future__ import annotations

from orientd.errors import LeaseError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.connection import Connection
from orientd.rpc.lease_keeper import LeaseKeeper

_RELEASE_TIMEOUT = 2.0
"""How long the daemon may take to hear that the lease is given back, s."""


class LeaseHolder:
    """A client of the daemon that holds the lease while it commands.

    Attributes:
        holder: what others are told when they are refused because of it.
    """

    def __init__(self, connection: Connection, *, holder: str) -> None:
        """Hold nothing until the first command over *connection*."""
        self.holder = holder
        self._connection = connection
        self._stub = connection.stub
        self._borrowed = ""
        self._keeper = LeaseKeeper(acquire=self._acquire, renew=self._renew, release=self._release)

    @property
    def lease_token(self) -> str:
        """The token of the lease that is held; empty before the first command."""
        return self._keeper.token() if self._keeper.is_held else ""

    def acquire_lease(self) -> None:
        """Take the lease now, rather than with the first command.

        Raises:
            LeaseError: somebody else holds it.
        """
        self._token()

    def borrow_lease(self, token: str) -> bool:
        """Command under a lease that somebody else keeps; return whether it is the present one.

        Args:
            token: from :attr:`lease_token` of whoever keeps it.
        """
        try:
            self._renew(token)
        except LeaseError:
            return False
        self._borrowed = token
        return True

    def adopt_lease(self, token: str) -> bool:
        """Keep a lease in the place of whoever keeps it; return whether it is the present one.

        Args:
            token: from :attr:`lease_token` of whoever keeps it.
        """
        try:
            self._keeper.adopt(token)
        except LeaseError:
            return False
        return True

    def forsake_lease(self) -> None:
        """Leave the lease, and what was started with it, to whoever has adopted it."""
        self._keeper.forsake()

    def release_lease(self) -> None:
        """Give the lease back now, rather than at the end; what still runs is stopped.

        One that is borrowed is left to whoever keeps it.
        """
        self._borrowed = ""
        self._keeper.release()

    def transfer_lease(self, to: str) -> float:
        """Hand the lease, and what runs under it, over to somebody else.

        Args:
            to: a user's name or number, or ``certificate:NAME``; they acquire the lease.

        Returns:
            For how many seconds it waits for them.

        Raises:
            RequestError: nobody is called so who may command.
            LeaseError: this client does not hold the lease.
        """
        request = pb.TransferLeaseRequest(token=self._token(), to=to)
        seconds: float = self._connection.ask(self._stub.TransferLease, request).seconds
        self._keeper.forsake()
        self._borrowed = ""
        return seconds

    def seize_lease(self, reason: str) -> None:
        """Take the lease whoever holds it; motions that run under it are stopped.

        Args:
            reason: why; it is recorded, and told to whoever runs a motion.

        Raises:
            AccessError: that is for administrators.
        """
        request = pb.SeizeLeaseRequest(holder=self.holder, reason=reason)
        self._keeper.hold(self._connection.ask(self._stub.SeizeLease, request).lease)

    def _token(self) -> str:
        return self._borrowed or self._keeper.token()

    def _acquire(self) -> pb.Lease:
        request = pb.AcquireLeaseRequest(holder=self.holder)
        lease: pb.Lease = self._connection.ask(self._stub.AcquireLease, request).lease
        return lease

    def _renew(self, token: str) -> pb.Lease:
        request = pb.RenewLeaseRequest(token=token)
        lease: pb.Lease = self._connection.ask(self._stub.RenewLease, request).lease
        return lease

    def _release(self, token: str) -> None:
        request = pb.ReleaseLeaseRequest(token=token)
        self._connection.call(self._stub.ReleaseLease, request, timeout=_RELEASE_TIMEOUT)
