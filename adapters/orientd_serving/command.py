"""`orientd serve`: serve a device by the protocols of other programs."""

from __future__ import annotations

import contextlib
import math
import signal
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from orientd.cli.command import Commander
from orientd.cli.installed import OpenGroup
from orientd.cli.interrupts import ignore
from orientd.cli.output import Output
from orientd.cli.parameters import Option

if TYPE_CHECKING:
    from orientd_serving.served import Adapter, Served

serve = OpenGroup(
    name="serve", help="Let antenna, MAVLink and astronomy programs control a device."
)


NORTH = Option(
    metavar="DEG",
    help="Angle from the x axis of the base frame to north, towards y.",
    range=(-360.0, 360.0),
)


def run(name: str, to: Commander, out: Output, adapter: Callable[[Served], Adapter]) -> None:
    """Serve until Ctrl-C or SIGTERM, then bring the device to rest.

    Prints a line that begins with "ready" and has the endpoint, and one at the end.

    Args:
        name: of the protocol.
        to: the daemon and the device.
        out: of the command.
        adapter: opens the adapter of a device.
    """
    from orientd_serving.served import Served  # `orientd --help` loads this module

    connected = contextlib.closing(to.connect(f"serve {name}"))
    with connected as robot, Served(robot, to.device) as served:
        opened = adapter(served)
        with contextlib.closing(opened):
            try:
                out.answer(
                    {"ready": True, "device": served.name, "endpoint": opened.endpoint},
                    f"ready at {opened.endpoint} ({name} for {served.name})",
                )
                opened.serve()
            except KeyboardInterrupt:
                # Later ones must not disturb the end.
                ignore((signal.SIGINT, signal.SIGTERM))
    out.answer({"ready": False, "device": served.name}, f"{served.name} is at rest")


def pair(
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
