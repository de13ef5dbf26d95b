"""Commands to a device: stop, pause, resume, speed, enable, disable, reset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orientd.cli.command import AsJson, Beside, DeviceName, Socket, command
from orientd.cli.output import answer

if TYPE_CHECKING:
    from orientd.rpc import DeviceReport, Robot


@command
def stop(device: DeviceName = "", socket: Socket = None, as_json: AsJson = False) -> None:
    """Bring a device, or all of them, to rest on the path.  Anybody may."""
    _bring_to_rest("stop", socket, as_json, lambda robot: robot.stop(device))


@command
def halt(device: DeviceName = "", socket: Socket = None, as_json: AsJson = False) -> None:
    """Bring a device, or all of them, to rest quickest, off the path.

    As quickly as the limits allow.  Anybody may.
    """
    _bring_to_rest("halt", socket, as_json, lambda robot: robot.halt(device))


@command
def pause(
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Come to rest on the path, to be resumed."""
    _command("pause", socket, device, lease, as_json, lambda robot: robot.pause(device))


@command
def resume(
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Go on with a paused motion."""
    _command("resume", socket, device, lease, as_json, lambda robot: robot.resume(device))


@command
def speed(
    factor: Annotated[
        float, typer.Argument(metavar="X", help="More than 0, at most 1, which is as planned.")
    ],
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Run motions X times as fast as planned, now and from now on."""
    _command("speed", socket, device, lease, as_json, lambda robot: robot.set_speed(factor, device))


@command
def enable(
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Make a device follow; it does not move by this."""
    _command("enable", socket, device, lease, as_json, lambda robot: robot.enable(device))


@command
def disable(
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Leave a device at rest, no longer following."""
    _command("disable", socket, device, lease, as_json, lambda robot: robot.disable(device))


@command
def reset(
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Clear a fault; starts the servo process anew if it has ended."""
    _command("reset", socket, device, lease, as_json, lambda robot: robot.reset(device))


def _bring_to_rest(
    name: str, socket: Path | None, as_json: bool, act: Callable[[Robot], list[DeviceReport]]
) -> None:
    from orientd.cli.at_rest import tell
    from orientd.cli.shared_lease import connect_as

    with connect_as(socket, name) as robot:
        reports = act(robot)
    tell(reports, as_json=as_json)


def _command(
    name: str,
    socket: Path | None,
    device: str,
    is_beside: bool,
    as_json: bool,
    act: Callable[[Robot], DeviceReport],
) -> None:
    from orientd.cli import texts
    from orientd.cli.shared_lease import commander

    with commander(socket, name, device, is_beside=is_beside) as robot:
        report = act(robot)
    speed = "" if report.speed == 1.0 else f", speed {report.speed:g}"
    answer(report, f"{report.name}: {texts.state(report)}{speed}", as_json=as_json)
