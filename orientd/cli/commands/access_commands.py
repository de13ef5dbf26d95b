"""`orientd lease`: control of devices."""

from __future__ import annotations

from typing import Annotated

from orientd.cli.command import DeviceName, Endpoint
from orientd.cli.output import Output
from orientd.cli.parameters import ANYTHING, Group, Option, part_of
from orientd.errors import OrientdError

lease = Group(name="lease", help="Take a lease away from its holder.")
audit = Group(name="audit", help="No longer there.", hidden=True)


@part_of(lease, hidden=True, context_settings=ANYTHING)
def give() -> None:
    """Report that leases can no longer be handed over."""
    raise OrientdError(
        "leases are not handed over any more: release yours, or have an administrator seize it"
    )


@part_of(lease)
def seize(
    at: Endpoint,
    out: Output,
    reason: Annotated[str, Option("--reason", help="Reason, for the holder and the audit log.")],
    device: DeviceName = "",
) -> None:
    """Seize the lease from its holder, and release it.

    This stops the holder's motions.  Only administrators may do it.
    """
    from orientd.protocol import control_pb2 as pb

    with at.connect("lease seize") as robot:
        leases = robot.state().daemon.leases
        before = [one for one in leases if not device or device in one.devices]
        robot.seize_lease(reason, *filter(None, [device]))
    first = before[0] if before else pb.LeaseReport()
    whose = ", ".join(f"{one.holder} ({one.identity})" for one in before)
    out.answer(
        {"holder": first.holder, "identity": first.identity, "leases": before},
        f"taken from {whose}; it is free now" if whose else "nobody held it; it is free",
    )


@part_of(audit, context_settings=ANYTHING)
def verify() -> None:
    """Report that the audit log no longer has a chain."""
    raise OrientdError("the audit log is no chain any more: there is nothing to verify")
