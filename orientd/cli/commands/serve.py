"""`orientd serve`: serve a device by the protocols of other programs."""

from __future__ import annotations

import contextlib
import math
import signal
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.command import Commander, need_extra
from orientd.cli.commands.view import Host
from orientd.cli.output import Output, complain
from orientd.cli.parameters import Group, Option, part_of

if TYPE_CHECKING:
    from orientd.adapters import Adapter, Served

serve = Group(name="serve", help="Let antenna, MAVLink and astronomy programs control a device.")


def _finite(
    context: click.Context, parameter: click.Parameter, given: float | None
) -> float | None:
    """Return the number of an option.

    Raises:
        click.BadParameter: it is not finite.
    """
    del context
    if given is not None and not math.isfinite(given):
        raise click.BadParameter(f"expected a finite number, got {given}", param=parameter)
    return given


_NORTH = Option(
    metavar="DEG",
    help="Angle from the x axis of the base frame to north, towards y.",
    callback=_finite,
)


def _interrupt(number: int, frame: object) -> None:
    """End the server at the first Ctrl-C or SIGTERM; later ones must not disturb its end."""
    del number, frame
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.SIG_IGN)
    raise KeyboardInterrupt


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

    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, _interrupt)
    with to.connect(f"serve {name}") as robot, Served(robot, to.device) as served:
        opened = adapter(served)
        with contextlib.closing(opened), contextlib.suppress(KeyboardInterrupt):
            out.answer(
                {"ready": True, "device": served.name, "endpoint": opened.endpoint},
                f"ready at {opened.endpoint} ({name} for {served.name})",
            )
            opened.serve()
    out.answer({"ready": False, "device": served.name}, f"{served.name} is at rest")


def _pair(
    separator: str, expected: str, is_valid: Callable[[float, float], bool]
) -> Callable[[click.Context, click.Parameter, str], tuple[float, float]]:
    """Return a callback that reads the two angles of an option, degrees.

    Args:
        separator: between the two.
        expected: what they are, with an example, for the message of an error.
        is_valid: whether both are in their ranges; false for NaN.
    """

    def read(context: click.Context, parameter: click.Parameter, given: str) -> tuple[float, float]:
        del context
        try:
            first, second = map(float, given.split(separator))
        except ValueError:
            first = second = math.nan
        if not is_valid(first, second):
            raise click.BadParameter(f"expected {expected}, got {given!r}", param=parameter)
        return first, second

    return read


_RANGE = _pair(
    ":",
    "two angles in degrees as in -180:540",
    lambda least, largest: -720.0 <= least < largest <= 720.0,
)
_DIRECTION = _pair(
    ",",
    "azimuth and altitude in degrees as in 180,30",
    lambda azimuth, altitude: abs(azimuth) <= 360.0 and abs(altitude) <= 90.0,
)


@part_of(serve)
def rotctld(
    to: Commander,
    out: Output,
    host: Host = "127.0.0.1",
    port: Annotated[int, Option(range=(0, 65535), help="Port to listen on; 0 for any.")] = 4533,
    north: Annotated[float, _NORTH] = 0.0,
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
            "--tle",
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
            "--ephemeris",
            help="CSV file of passes of a target, to plan them whole: time, azimuth, elevation.",
        ),
    ] = None,
) -> None:
    """Serve antenna programs: gpredict, SatNOGS, SDRangel, `rotctl`.

    The server speaks the protocol of Hamlib's rotctld.  It points the x axis of the tool at the
    requested azimuth (clockwise from north) and elevation.
    """
    from orientd import adapters

    if (tle is None) != (not observer):
        raise click.UsageError("expected --tle and --observer together, or neither")
    targets = [] if ephemeris is None else adapters.from_table(ephemeris)
    if tle is not None:
        targets += adapters.from_elements(tle, adapters.observer_of(observer))
    ranges = adapters.Ranges(azimuth, elevation)  # type: ignore[arg-type] # from the callbacks
    run(
        "rotctld",
        to,
        out,
        lambda served: adapters.Rotctld(
            served,
            host=host,
            port=port,
            ranges=ranges,
            north=north,
            targets=targets,
            notify=out.say,
        ),
    )


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


@part_of(serve)
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
    north: Annotated[
        float | None,
        Option(
            metavar="DEG",
            help="Angle from the x axis of the base frame to north, towards y; default: unknown.",
            callback=_finite,
        ),
    ] = None,
) -> None:
    """Serve MAVLink programs: QGroundControl, MAVSDK, an autopilot.

    The device becomes a gimbal with a gimbal manager (gimbal protocol v2). Forward is the x axis of
    the tool.  Yaw is positive to the right, pitch upwards.
    """
    need_extra("mavlink")
    from orientd.adapters import Mavlink

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


@part_of(serve)
def alpaca(
    to: Commander,
    out: Output,
    host: Host = "127.0.0.1",
    port: Annotated[int, Option(range=(0, 65535), help="Port to listen on; 0 for any.")] = 11111,
    discovery: Annotated[
        int, Option(range=(0, 65535), help="UDP port for discovery; 0 for none.")
    ] = 32227,
    north: Annotated[float, _NORTH] = 0.0,
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
    from orientd import adapters

    place = adapters.Place(*adapters.observer_of(observer))
    azimuth, altitude = map(float, park)

    def opened(served: Served) -> Adapter:
        mount = adapters.Mount(served, north=north)
        parking = adapters.Direction(azimuth, altitude)
        devices = [
            adapters.Telescope(mount, place=place, park=parking),
            adapters.Rotator(mount, is_symmetric=symmetric),
        ]
        return adapters.Alpaca(devices, host=host, port=port, discovery=discovery)

    run("alpaca", to, out, opened)
