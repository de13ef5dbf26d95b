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


def _bringing_to_rest(name: str, does: str) -> Callable[..., None]:
    """Return the command *name*, which any client may give; *does* is its help."""

    def run(device: DeviceName = "", socket: Socket = None, as_json: AsJson = False) -> None:
        from orientd.cli.at_rest import tell
        from orientd.cli.shared_lease import connect_as

        with connect_as(socket, name) as robot:
            reports = getattr(robot, name)(device)
        tell(reports, as_json=as_json)

    run.__name__, run.__doc__ = name, does
    return command(run)


def _commanding(name: str, does: str) -> Callable[..., None]:
    """Return the command *name* to one device, under its lease; *does* is its help."""

    def run(
        device: DeviceName = "",
        lease: Beside = False,
        socket: Socket = None,
        as_json: AsJson = False,
    ) -> None:
        _command(name, socket, device, lease, as_json, lambda robot: getattr(robot, name)(device))

    run.__name__, run.__doc__ = name, does
    return command(run)


stop = _bringing_to_rest(
    "stop", "Bring a device, or all of them, to rest on the path.  Anybody may."
)
halt = _bringing_to_rest(
    "halt",
    "Bring a device, or all of them, to rest quickest, off the path.\n\n"
    "As quickly as the limits allow.  Anybody may.",
)
pause = _commanding("pause", "Come to rest on the path, to be resumed.")
resume = _commanding("resume", "Go on with a paused motion.")
enable = _commanding("enable", "Make a device follow; it does not move by this.")
disable = _commanding("disable", "Leave a device at rest, no longer following.")
reset = _commanding("reset", "Clear a fault; starts the servo process anew if it has ended.")


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
