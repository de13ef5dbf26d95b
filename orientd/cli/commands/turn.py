"""Commands that turn a device: home, and at a constant rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal

from orientd.cli.command import Commander
from orientd.cli.commands.motion_commands import conclude, follow
from orientd.cli.output import Output
from orientd.cli.parameters import Option
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd.client import EndlessTurn, MoveHandle, Robot


def home(to: Commander, out: Output) -> None:
    """Turn every axis of a gimbal to zero, and unwind whole turns.

    Ctrl-C stops it on its path.
    """
    _run("home", lambda robot: robot.home(to.device), to, out)


def turn(
    to: Commander,
    out: Output,
    rate: Annotated[
        float,
        Option("--rate", metavar="RAD/S", help="Rate; a negative one turns the other way."),
    ],
    duration: Annotated[
        float | None,
        Option(
            "--duration",
            metavar="SECONDS",
            help="Duration at that rate; default: until a stop.",
        ),
    ] = None,
    axis: Annotated[Literal["x", "y", "z"], Option("--axis", help="Axis of the turn.")] = "z",
    velocity_frame: Annotated[
        Literal["body", "world"],
        Option("--frame", help="Frame of the axis: the tool's or the world's."),
    ] = "body",
) -> None:
    """Turn at a constant rate, from rest to rest, like a turntable.

    The turn begins at the present orientation.  Ctrl-C stops it on its path.  Without a duration it
    continues until a stop, or until an axis of a gimbal comes near the end of its range.
    """
    omega = [rate if letter == axis else 0.0 for letter in "xyz"]

    def begin(robot: Robot) -> MoveHandle | EndlessTurn:
        fields = {"device": to.device, "velocity_frame": velocity_frame, "name": "turn"}
        if duration is None:
            return robot.turn_endlessly(omega, **fields)
        return robot.turn(omega, duration, **fields)

    _run("turn", begin, to, out)


def _run(
    name: str, begin: Callable[[Robot], MoveHandle | EndlessTurn], to: Commander, out: Output
) -> None:
    with to.connect(name) as robot:
        handle = begin(robot)
        summary = follow(handle, out, title=name, lines=handle.plan.certificate.notes)
    conclude(handle, summary, out)
    if problem := getattr(handle, "problem", ""):
        raise OrientdError(f"the turn could not continue: {problem}")
