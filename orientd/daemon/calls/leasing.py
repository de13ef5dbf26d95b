"""The lease: taken, kept, given back, seized."""

from __future__ import annotations

from orientd.daemon.access import Caller
from orientd.daemon.calls.calls import Calls
from orientd.daemon.leases import Lease
from orientd.rpc import control_pb2 as pb


class LeasingCalls(Calls):
    """Calls about who may command."""

    async def AcquireLease(
        self, request: pb.AcquireLeaseRequest, caller: Caller
    ) -> pb.AcquireLeaseResponse:
        """Take the lease of devices that nobody else has."""
        lease = await self._cell.in_worker(
            lambda: self._cell.leases.acquire(
                request.holder,
                caller.identity.key,
                name=caller.identity.name,
                devices=self._cell.named(request.devices),
                beside=request.beside,
            ),
        )
        return pb.AcquireLeaseResponse(lease=self._lease_message(lease))

    async def RenewLease(
        self, request: pb.RenewLeaseRequest, caller: Caller
    ) -> pb.RenewLeaseResponse:
        """Hold the lease for its full time again."""
        # At once and not in a worker, which might be busy until the lease has run out.
        lease = self._cell.leases.renew(request.token)
        return pb.RenewLeaseResponse(lease=self._lease_message(lease))

    async def ReleaseLease(
        self, request: pb.ReleaseLeaseRequest, caller: Caller
    ) -> pb.ReleaseLeaseResponse:
        """Give the lease back."""
        await self._cell.in_worker(lambda: self._cell.leases.release(request.token))
        return pb.ReleaseLeaseResponse()

    async def SeizeLease(
        self, request: pb.SeizeLeaseRequest, caller: Caller
    ) -> pb.SeizeLeaseResponse:
        """Take the lease whoever holds it."""
        lease = await self._cell.in_worker(
            lambda: self._cell.leases.seize(
                request.holder,
                caller.identity.key,
                request.reason,
                name=caller.identity.name,
                devices=self._cell.named(request.devices),
            ),
        )
        return pb.SeizeLeaseResponse(lease=self._lease_message(lease))

    def _lease_message(self, lease: Lease) -> pb.Lease:
        return pb.Lease(
            token=lease.token,
            holder=lease.holder,
            seconds=self._cell.leases.remaining(lease),
            devices=lease.devices,
        )
