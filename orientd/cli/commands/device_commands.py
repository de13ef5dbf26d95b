"""Commands to a device: stop, pause, resume, speed, enable, disable, reset."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

from orientd.cli.command import Commander, Endpoint, OneOrAll
from orientd.cli.output import Output
from orientd.cli.parameters import Argument
from orientd.errors import DaemonError, OrientdError

if TYPE_CHECKING:
    from orientd.client.robot import Robot
    from orientd.protocol import control_pb2 as pb


def _of_all(name: str, told: str) -> Callable[..., None]:
    """Return the command that stops devices, independent of their leases."""

    def act(at: Endpoint, out: Output, device: OneOrAll = "") -> None:
        from orientd.cli import urgent

        try:
            with at.connect(name) as robot:
                reports = getattr(robot, name)(device)
        except DaemonError:
            # Some devices may have stopped: the state of each, above the error.
            with contextlib.suppress(OrientdError):
                urgent.tell_now(at.way(), device, out)
            raise
        urgent.tell(reports, out)

    return _named(name, told, act)


def _of_one(name: str, told: str) -> Callable[..., None]:
    """Return the command that calls the client's method of that name."""

    def act(to: Commander, out: Output) -> None:
        _command(name, to, out, lambda robot: getattr(robot, name)(to.device))

    return _named(name, told, act)


def _named(name: str, told: str, act: Callable[..., None]) -> Callable[..., None]:
    act.__name__, act.__doc__ = name, told
    return act


def _command(
    name: str, to: Commander, out: Output, act: Callable[[Robot], pb.DeviceReport]
) -> None:
    from orientd.cli import texts

    with to.connect(name) as robot:
        report = act(robot)
    speed = "" if report.speed == 1.0 else f", speed {report.speed:g}"
    out.answer(report, f"{report.name}: {texts.state(report)}{speed}")


stop = _of_all("stop", "Stop a device, or all of them, on the path.  Needs no lease.")
halt = _of_all(
    "halt",
    """Stop a device, or all of them, as fast as the limits permit.

    The device may leave its path.  Needs no lease.
    """,
)
pause = _of_one("pause", "Stop on the path; `orientd resume` continues.")
resume = _of_one("resume", "Resume a paused motion.")
enable = _of_one("enable", "Enable a device, so that it follows setpoints; it does not move.")
disable = _of_one("disable", "Disable a device at rest, so that it no longer follows setpoints.")
reset = _of_one("reset", "Clear a fault, and start the servo process again if it has ended.")


def speed(
    to: Commander,
    out: Output,
    factor: Annotated[
        float, Argument(metavar="X", help="Speed factor: above 0, at most 1 (as planned).")
    ],
) -> None:
    """Run motions at X times the planned speed, from now on."""
    _command("speed", to, out, lambda robot: robot.set_speed(factor, to.device))
