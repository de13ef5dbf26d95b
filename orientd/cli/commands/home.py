"""The command that brings the axes of a gimbal home."""

from __future__ import annotations

from orientd.cli.command import AsJson, Beside, DeviceName, Socket, command
from orientd.cli.commands.device_commands import holder
from orientd.cli.commands.motion_commands import follow, raise_unless_done
from orientd.cli.output import say, say_json


@command
def home(
    device: DeviceName = "", lease: Beside = False, socket: Socket = None, as_json: AsJson = False
) -> None:
    """Turn every axis of a gimbal to zero, the way back it came.

    Ctrl-C stops it on its path.
    """
    from orientd.cli import texts
    from orientd.cli.shared_lease import commander

    with commander(socket, holder("home"), device, is_beside=lease, is_shared=True) as robot:
        handle = robot.home(device)
        notes = handle.plan.certificate.notes
        summary = follow(handle, title="home", notes=notes, is_silent=as_json)
    if as_json:
        say_json({"plan": handle.plan, "summary": summary, "speed": handle.speed})
    else:
        say(*texts.summary(summary, handle.plan, speed=handle.speed))
    raise_unless_done(summary)
