"""`orientd serve rotctld`: serve antenna programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from orientd.cli.command import Commander, Host, Port
from orientd.cli.output import Output, complain
from orientd.cli.parameters import Option, command
from orientd_rotctld.ephemeris import from_table
from orientd_rotctld.ranges import Ranges
from orientd_rotctld.rotctld import Rotctld
from orientd_rotctld.sky import from_elements
from orientd_serving.command import NORTH, pair, run
from orientd_serving.pointing import observer_of

_RANGE = pair(
    ":",
    "two angles in degrees as in -180:540",
    lambda least, largest: -720.0 <= least < largest <= 720.0,
)


@command
def rotctld(
    to: Commander,
    out: Output,
    host: Host = "127.0.0.1",
    port: Port = 4533,
    north: Annotated[float, NORTH] = 0.0,
    azimuth: Annotated[
        str,
        Option(metavar="MIN:MAX", help="Range of azimuths to accept, degrees.", callback=_RANGE),
    ] = "-180:540",
    elevation: Annotated[
        str,
        Option(
            metavar="MIN:MAX",
            help="Range of elevations to accept, degrees; above 90 is flip mode.",
            callback=_RANGE,
        ),
    ] = "-90:90",
    tle: Annotated[
        Path | None,
        Option(
            help="File of orbital elements (TLE), to plan whole passes of these satellites.",
        ),
    ] = None,
    observer: Annotated[
        str,
        Option(
            metavar="LAT,LON[,M]",
            help="Location of the antenna: degrees, and m above sea level (with --tle).",
        ),
    ] = "",
    ephemeris: Annotated[
        Path | None,
        Option(
            help="CSV file of passes of a target, to plan them whole: time, azimuth, elevation."
        ),
    ] = None,
) -> None:
    """Serve antenna programs: gpredict, SatNOGS, SDRangel, `rotctl`.

    The server speaks the protocol of Hamlib's rotctld.  It points the x axis of the tool at the
    requested azimuth (clockwise from north) and elevation.
    """
    if (tle is None) != (not observer):
        raise click.UsageError("expected --tle and --observer together, or neither")
    targets = []
    if ephemeris is not None:
        table = from_table(ephemeris)
        targets.append(table.target)
        if table.is_exact:
            out.say(table.summary)
        else:
            complain({"message": table.summary}, as_json=out.as_json)
    if tle is not None:
        targets += from_elements(tle, observer_of(observer))
    ranges = Ranges(azimuth, elevation, north)  # type: ignore[arg-type] # from the callbacks
    run(
        "rotctld",
        to,
        out,
        lambda served: Rotctld(
            served,
            host=host,
            port=port,
            ranges=ranges,
            targets=targets,
            notify=out.say,
        ),
    )
