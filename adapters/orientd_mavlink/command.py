"""`orientd serve mavlink`: serve MAVLink programs."""

from __future__ import annotations

import math
import socket
from collections.abc import Sequence
from typing import Annotated

import click

from orientd.cli.command import Commander, Host, need_extra
from orientd.cli.output import Output, complain
from orientd.cli.parameters import Option, command
from orientd_serving.command import NORTH, run


def _peers(
    context: click.Context, parameter: click.Parameter, given: Sequence[str]
) -> list[tuple[str, int]]:
    """Return the addresses of an option.

    Raises:
        click.BadParameter: one is no address.
    """
    del context
    peers = []
    for one in given:
        host, _, port = one.rpartition(":")
        try:
            peers.append((socket.gethostbyname(host), int(port)))
            if not 0 < peers[-1][1] < 65536:
                raise ValueError
        except (ValueError, OSError):
            raise click.BadParameter(f"expected HOST:PORT, got {one!r}", param=parameter) from None
    return peers


@command
def mavlink(
    to: Commander,
    out: Output,
    host: Host = "127.0.0.1",
    port: Annotated[
        int, Option(range=(0, 65535), help="UDP port to listen on; 0 for any.")
    ] = 14560,
    client: Annotated[
        list[str] | None,
        Option(
            metavar="HOST:PORT",
            help="Program to send to first; default: 127.0.0.1:14550.",
            callback=_peers,
        ),
    ] = None,
    system: Annotated[int, Option(range=(1, 255), help="MAVLink system ID of the vehicle.")] = 1,
    component: Annotated[
        int, Option(range=(7, 255), help="MAVLink component ID of the gimbal.")
    ] = 154,
    north: Annotated[float | None, NORTH] = None,
) -> None:
    """Serve MAVLink programs: QGroundControl, MAVSDK, an autopilot.

    The device becomes a gimbal with a gimbal manager (gimbal protocol v2). Forward is the x axis of
    the tool.  Yaw is positive to the right, pitch upwards.  Without --north the heading is unknown.
    """
    need_extra("mavlink")
    from orientd_mavlink.server import Mavlink

    run(
        "mavlink",
        to,
        out,
        lambda served: Mavlink(
            served,
            host=host,
            port=port,
            to=client or [("127.0.0.1", 14550)],  # type: ignore[arg-type] # as the callback returns
            system=system,
            component=component,
            north=None if north is None else math.radians(north),
            warn=lambda problem: complain({"message": problem}, as_json=out.as_json),
        ),
    )
