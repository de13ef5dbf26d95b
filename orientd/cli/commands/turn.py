"""The command that turns a device at a constant rate, as a turntable."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from orientd.cli.command import AsJson, Beside, DeviceName, Socket, command
from orientd.cli.commands.device_commands import holder
from orientd.cli.commands.motion_commands import follow, raise_unless_done
from orientd.cli.output import say, say_json


class AxisName(StrEnum):
    """Axes to turn about."""

    X = "x"
    Y = "y"
    Z = "z"


class VelocityFrame(StrEnum):
    """Whose axes they are."""

    BODY = "body"
    WORLD = "world"


@command
def turn(
    rate: Annotated[
        float, typer.Option("--rate", metavar="RAD/S", help="How fast; negative the other way.")
    ],
    duration: Annotated[
        float, typer.Option("--duration", metavar="SECONDS", help="For how long at that rate.")
    ],
    axis: Annotated[AxisName, typer.Option("--axis", help="About which axis.")] = AxisName.Z,
    velocity_frame: Annotated[
        VelocityFrame, typer.Option("--frame", help="Whether it is the tool's or the world's.")
    ] = VelocityFrame.BODY,
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Turn at a constant rate from wherever the device is, from rest and to rest.

    Ctrl-C stops it on its path.
    """
    from orientd.cli import texts
    from orientd.cli.shared_lease import commander

    omega = [rate if letter == axis.value else 0.0 for letter in "xyz"]
    with commander(socket, holder("turn"), device, is_beside=lease, is_shared=True) as robot:
        handle = robot.turn(
            omega, duration, device=device, velocity_frame=velocity_frame.value, name="turn"
        )
        notes = handle.plan.certificate.notes
        summary = follow(handle, title="turn", notes=notes, is_silent=as_json)
    if as_json:
        say_json({"plan": handle.plan, "summary": summary, "speed": handle.speed})
    else:
        say(*texts.summary(summary, handle.plan, speed=handle.speed))
    raise_unless_done(summary)
