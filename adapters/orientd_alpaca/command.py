"""`orientd serve alpaca`: serve astronomy programs."""

from __future__ import annotations

from typing import Annotated

from orientd.cli.command import Commander, Host, Port
from orientd.cli.output import Output
from orientd.cli.parameters import Option, command
from orientd_alpaca.mount import Mount, Rotator
from orientd_alpaca.server import Alpaca
from orientd_alpaca.telescope import Telescope
from orientd_serving.command import NORTH, pair, run
from orientd_serving.pointing import Direction, Place, observer_of
from orientd_serving.served import Adapter, Served

_DIRECTION = pair(
    ",",
    "azimuth and altitude in degrees as in 180,30",
    lambda azimuth, altitude: abs(azimuth) <= 360.0 and abs(altitude) <= 90.0,
)


@command
def alpaca(
    to: Commander,
    out: Output,
    host: Host = "127.0.0.1",
    port: Port = 11111,
    discovery: Annotated[
        int, Option(range=(0, 65535), help="UDP port for discovery; 0 for none.")
    ] = 32227,
    north: Annotated[float, NORTH] = 0.0,
    observer: Annotated[
        str,
        Option(
            metavar="LAT,LON[,M]", help="Location of the telescope: degrees, and m above sea level."
        ),
    ] = "0,0",
    park: Annotated[
        str,
        Option(metavar="AZ,ALT", help="Park position, degrees.", callback=_DIRECTION),
    ] = "0,0",
    symmetric: Annotated[
        bool, Option("--symmetric", help="Treat rotator angles half a turn apart as equal.")
    ] = False,
) -> None:
    """Serve astronomy programs: NINA and others that speak ASCOM Alpaca.

    The device becomes an alt-azimuth telescope that points along the x axis of the tool, and a
    rotator about that axis.
    """
    place = Place(*observer_of(observer))
    azimuth, altitude = map(float, park)

    def opened(served: Served) -> Adapter:
        mount = Mount(served, north=north)
        parking = Direction(azimuth, altitude)
        devices = [
            Telescope(mount, place=place, park=parking),
            Rotator(mount, is_symmetric=symmetric),
        ]
        return Alpaca(devices, host=host, port=port, discovery=discovery)

    run("alpaca", to, out, opened)
