"""`orientd serve`: let programs that speak another protocol command a device."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.command import Commander
from orientd.cli.commands.view import Host
from orientd.cli.output import Output
from orientd.cli.parameters import Group, Option, part_of

if TYPE_CHECKING:
    from orientd.adapters import Adapter, Served

serve = Group(name="serve", help="Let programs that speak another protocol command a device.")


def run(name: str, to: Commander, out: Output, adapter: Callable[[Served], Adapter]) -> None:
    """Serve until Ctrl-C or SIGTERM, then bring the device to rest.

    Prints a line that begins with "ready" and has the endpoint, and one at the end.

    Args:
        name: of the protocol.
        to: the daemon and the device.
        out: of the command.
        adapter: opens the adapter of a device.
    """
    from orientd.adapters import Served

    with to.connect(f"serve {name}") as robot, Served(robot, to.device) as served:
        opened = adapter(served)
        with contextlib.closing(opened), contextlib.suppress(KeyboardInterrupt):
            out.answer(
                {"ready": True, "device": served.name, "endpoint": opened.endpoint},
                f"ready at {opened.endpoint} ({name} for {served.name})",
            )
            opened.serve()
    out.answer({"ready": False, "device": served.name}, f"{served.name} is at rest")


def _range(context: click.Context, parameter: click.Parameter, given: str) -> tuple[float, float]:
    """Return the two angles of an option.

    Raises:
        click.BadParameter: it is no range.
    """
    del context
    try:
        least, largest = map(float, given.split(":"))
    except ValueError:
        least = largest = math.nan
    if not -720.0 <= least < largest <= 720.0:
        raise click.BadParameter(
            f"expected two angles in degrees as in -180:540, got {given!r}", param=parameter
        )
    return least, largest


@part_of(serve)
def rotctld(
    to: Commander,
    out: Output,
    host: Host = "127.0.0.1",
    port: Annotated[int, Option(range=(0, 65535), help="Port to serve at; 0 for any.")] = 4533,
    north: Annotated[
        float,
        Option(metavar="DEG", help="Angle of north from the world's x axis, towards y."),
    ] = 0.0,
    azimuth: Annotated[
        str, Option(metavar="MIN:MAX", help="Azimuths to accept, degrees.", callback=_range)
    ] = "-180:540",
    elevation: Annotated[
        str,
        Option(
            metavar="MIN:MAX",
            help="Elevations to accept; above 90 the device tips over.",
            callback=_range,
        ),
    ] = "-90:90",
) -> None:
    """Serve antenna programs: gpredict, SatNOGS, SDRangel, `rotctl`.

    They speak the protocol of Hamlib's rotctld.  The x axis of the tool points at the azimuth and
    elevation that they ask for.  Azimuth counts clockwise from north.
    """
    from orientd.adapters import Direction, Ranges, Rotctld

    ranges = Ranges(azimuth, elevation)  # type: ignore[arg-type] # as the callbacks return them
    run(
        "rotctld",
        to,
        out,
        lambda served: Rotctld(
            served,
            host=host,
            port=port,
            ranges=ranges,
            north=north,
            park=Direction(0.0, 0.0),
        ),
    )
