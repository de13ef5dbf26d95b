"""Motions: plan one without a daemon, move a device, turn it home or at a constant rate."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click

from orientd.cli.command import (
    Commander,
    ConfigFile,
    DeviceName,
    check_ending,
    check_picture,
    device_settings,
)
from orientd.cli.following import conclude, follow
from orientd.cli.output import Output, working
from orientd.cli.parameters import Argument, Option
from orientd.errors import OrientdError
from orientd.one_line import counted

if TYPE_CHECKING:
    from orientd.client.endless_turn import EndlessTurn
    from orientd.client.motion_text import MotionText
    from orientd.client.move_handle import MoveHandle
    from orientd.client.robot import Robot
    from orientd.protocol import control_pb2 as pb


def _standard_input(context: click.Context, parameter: click.Parameter, file: Path) -> Path:
    del context, parameter
    return Path("/dev/stdin") if file == Path("-") else file


MotionFile = Annotated[
    Path,
    Argument(
        metavar="FILE",
        help="A motion file, YAML or JSON; - for standard input.",
        callback=_standard_input,
    ),
]

LATEST_START = 3600.0
"""How far ahead the daemon accepts a start time, s."""


def plan(
    out: Output,
    file: MotionFile,
    output: Annotated[
        Path | None,
        Option("--output", "-o", help="Write samples to a .csv, .npz or .json file."),
    ] = None,
    plot: Annotated[
        Path | None, Option("--plot", help="Draw the motion to an image file (extra plot).")
    ] = None,
    config: ConfigFile = None,
    device: DeviceName = "",
    from_robot: Annotated[
        bool,
        Option("--from-robot", help="Start at the pose that the device reports; nothing moves."),
    ] = False,
) -> None:
    """Plan the motion of FILE without a daemon.

    The device starts at the first keyframe.  An arm starts at the joint angles in its options, or
    with --from-robot at those that it reports. Rate, limits and axes are those of the device in the
    configuration.  The samples are the setpoints that its servo would send.
    """
    from orientd import motion_file
    from orientd.cli import sample_files, texts
    from orientd.daemon.planners.reporting import plan_of, samples_of

    if output is not None:
        check_ending(output, sample_files.ENDINGS, named="--output")
    if plot is not None:
        check_picture(plot)
    request = motion_file.load(file)
    settings = device_settings(config, device)
    planner = settings.planner()
    with working(f"planning {file.name}"):
        motion = planner.plan_offline(request, from_device=from_robot)
    samples = samples_of(motion, settings.rate_hz, planner.report_frame(request))
    planned = plan_of(motion)
    if output is not None:
        sample_files.write(output, samples, planned.certificate)
    if plot is not None:
        from orientd import plots

        with working(f"drawing {plot}"):
            plots.draw(motion, plot, title=f"{file.name}: {request.method}")
    out.answer(
        {"plan": planned, "output": output, "plot": plot},
        f"{request.method} through {len(request.keyframes)} keyframes",
        "",
        *texts.certificate(planned.certificate),
        *(f"wrote {written}" for written in (output, plot) if written is not None),
    )


def move(
    to: Commander,
    out: Output,
    file: MotionFile,
    queue: Annotated[
        bool, Option("--queue", help="Run after the current motion instead of replacing it.")
    ] = False,
    blend: Annotated[
        float,
        Option(
            metavar="DEGREES",
            help="Cut the corner by at most this angle instead of stopping (with --queue).",
        ),
    ] = 0.0,
    start_in: Annotated[
        float | None,
        Option(metavar="SECONDS", help="Plan now, and start after this time."),
    ] = None,
    on_target: Annotated[
        str,
        Option(
            metavar="DEG,DEG/S,S[,S]",
            help="The motion is done when the measured error (degrees) and rate (degrees/s) have "
            "stayed below these values for this time (s); last an optional timeout (s).",
        ),
    ] = "",
) -> None:
    """Run the motion of FILE on a device, and show its progress.

    It replaces a running motion without a step.  Ctrl-C stops the device on its path.  While
    it runs, `orientd pause`, `resume`, `speed` and `move` need `--lease` in another terminal.
    """
    from orientd.cli import texts
    from orientd.client.connection import StartAt
    from orientd.client.motion_text import motion_text
    from orientd.protocol.reports import titled

    if blend and not queue:
        raise click.BadParameter("needs --queue", param_hint="--blend")
    if not 0.0 <= blend <= 180.0:
        raise click.BadParameter(f"expected 0 to 180 degrees, got {blend:g}", param_hint="--blend")
    if start_in is not None and not 0.0 < start_in <= LATEST_START:
        raise click.BadParameter(
            f"expected above 0 and up to {LATEST_START:g} s from now, got {start_in:g}",
            param_hint="--start-in",
        )
    gate = _gate(on_target) if on_target else None
    motion = motion_text(file)
    with _file_first(motion), to.connect("move") as robot:
        start = None
        if start_in is not None:
            # The time of day of this machine may not be that of the daemon's.
            start_ns = time.monotonic_ns() + round(start_in * 1e9)
            start = StartAt(start_ns + robot.clock_offset.ns)
        handle = robot.move(
            motion,
            device=to.device,
            queue=queue,
            blend_tolerance=math.radians(blend),
            start_time=start,
            on_target=gate,
        )
        plan = handle.plan
        title = f"motion {titled(handle.motion_number, plan.name)}"
        introduction = (
            f"{title}: {counted(len(plan.keyframe_times), 'keyframe')}, {plan.duration:.3f} s "
            f"with a lead-in of {plan.certificate.lead_in:.3f} s and a lead-out of "
            f"{plan.certificate.lead_out:.3f} s"
        )
        losses = [f"target lost {loss}" for loss in texts.losses(plan.certificate)]
        lines = [introduction, *losses, *plan.certificate.notes]
        summary = follow(handle, out, title=title, lines=lines)
    conclude(handle, summary, out)


@contextlib.contextmanager
def _file_first(motion: MotionText) -> Iterator[None]:
    """Say what is wrong with a motion file rather than why nothing can run now."""
    try:
        yield
    except OrientdError:
        from orientd import motion_file

        motion_file.loads(motion.text, motion.source)
        raise


def _gate(text: str) -> pb.OnTarget:
    """Return the gate in ``DEG,DEG/S,S[,S]``."""
    from orientd.protocol import control_pb2 as pb

    try:
        tolerance, rate, *seconds = map(float, text.split(","))
        if not 1 <= len(seconds) <= 2 or not all(
            part > 0.0 and math.isfinite(part) for part in (tolerance, rate, *seconds)
        ):
            raise ValueError
    except ValueError:
        raise click.BadParameter(
            "expected degrees, degrees/s and seconds, each above 0, like 0.1,0.5,0.2, "
            f"got {text!r}",
            param_hint="--on-target",
        ) from None
    settle_time, *timeout = seconds
    return pb.OnTarget(
        tolerance=math.radians(tolerance),
        rate=math.radians(rate),
        settle_time=settle_time,
        timeout=timeout[0] if timeout else 0.0,
    )


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
        Option("--rate", metavar="RAD/S", help="Rate; negative turns the other way."),
    ],
    duration: Annotated[
        float | None,
        Option(
            "--duration",
            metavar="SECONDS",
            help="Duration at this rate; default: until you stop it.",
        ),
    ] = None,
    axis: Annotated[Literal["x", "y", "z"], Option("--axis", help="Axis to turn about.")] = "z",
    velocity_frame: Annotated[
        Literal["body", "world"],
        Option("--frame", help="Frame of the axis: of the tool (body) or the base (world)."),
    ] = "body",
) -> None:
    """Turn at a constant rate, from rest to rest, like a turntable.

    The turn begins at the current orientation.  Ctrl-C stops it on its path.  Without a duration it
    continues until you stop it, or until an axis of a gimbal comes near the end of its range.
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
