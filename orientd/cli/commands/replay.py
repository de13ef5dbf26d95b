"""Replay: a recorded orientation, fitted, planned and moved."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from orientd.cli.command import (
    AsJson,
    Beside,
    ConfigFile,
    DeviceName,
    Partial,
    Socket,
    Topic,
    command,
)
from orientd.cli.commands.record import need_record
from orientd.cli.completion import TAKES, files
from orientd.cli.output import answer, say
from orientd.cli.usage import check_ending
from orientd.cli.waiting import working

if TYPE_CHECKING:
    from collections.abc import Callable

    from orientd.curves import Fit
    from orientd.planner import MotionRequest


Pace = Literal["recorded", "minimum"]
"""How fast a recording is repeated."""


@command
def replay(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="A .mcap file (ours or not), a .csv file (also of EuRoC), a TUM trajectory "
            "(.tum, .txt), or a ROS 2 bag: its folder or .db3 file.",
            autocompletion=files(*TAKES),
        ),
    ],
    topic: Topic = "",
    partial: Partial = False,
    error: Annotated[
        float,
        typer.Option(
            "--error", metavar="DEGREES", help="How far from the filtered samples to stay."
        ),
    ] = 1.0,
    pace: Annotated[
        Pace,
        typer.Option(
            "--pace", help="As recorded, slowed down where the limits ask for it, or the quickest."
        ),
    ] = "recorded",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Write the motion file (.json), for `orientd move`."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Plan only, without a daemon, and move nothing.")
    ] = False,
    config: ConfigFile = None,
    device: DeviceName = "",
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Repeat a recorded orientation.

    A spline is fitted to it and planned; its certificate is shown before anything moves.  Noise,
    sign flips, wild samples and gaps are dealt with.  The motion begins with a lead-in from
    wherever the device is and ends with a stop, both certified with it.
    """
    need_record()
    from orientd.curves import fit_orientations
    from orientd.recorder import read_orientations

    if not 0.0 < error < 180.0:
        raise typer.BadParameter(
            f"expected more than 0 and less than 180 degrees, got {error:g}", param_hint="--error"
        )
    if output is not None:
        check_ending(output, [".json"], named="--output")
    with working(f"reading {file}", is_silent=as_json):
        found = read_orientations(file, topic, partial=partial)
    with working(f"fitting {len(found.times)} samples", is_silent=as_json):
        fit = fit_orientations(found.times, found.q, tolerance=math.radians(error))
    told = _told(found.topic, fit)
    notes = told["notes"] = [*found.notes, *_lost(fit)]
    if not as_json:
        say(
            *(f"note: {note}" for note in notes),
            f"{told['topic'] or 'orientation'}: {told['samples']} samples in "
            f"{told['seconds']:.2f} s, noise {told['noise_deg']:.3f} deg, "
            f"{told['left_out']} left out",
            f"spline with {told['knots']} knots, at most {told['error_deg']:.3f} deg from the "
            "filtered samples",
        )
    if dry_run:
        _plan_offline(fit, told, pace, config, device, output, as_json=as_json)
    else:
        _move(fit, told, pace, device, lease, socket, output, as_json=as_json)


def _lost(fit: Fit) -> list[str]:
    """Return a note where most samples were left out."""
    count, left_out = len(fit.samples.times), fit.samples.left_out
    if left_out <= count:
        return []
    return [f"more than half of the samples are left out: {left_out} of {left_out + count}"]


def _told(topic: str, fit: Fit) -> dict[str, Any]:
    return {
        "topic": topic,
        "samples": len(fit.samples.times),
        "left_out": fit.samples.left_out,
        "seconds": fit.seconds,
        "noise_deg": math.degrees(fit.samples.noise),
        "knots": fit.knot_count,
        "error_deg": math.degrees(fit.error),
    }


def _paced(
    fit: Fit, pace: Pace, plan: Callable[[MotionRequest], Any], output: Path | None
) -> tuple[Any, float]:
    """Plan the replay, and write the motion file of it; return the plan and how much it is slower.

    Raises:
        OrientdError: it cannot be planned, or the file cannot be written.
    """
    from orientd import motion_file
    from orientd.planner import plan_as_recorded, replay_request
    from orientd.structured_text import write_structured

    if pace == "recorded":
        planned, request, slower = plan_as_recorded(fit, plan)
    else:
        request = replay_request(fit)
        planned = plan(request)
        slower = (planned.end_time - planned.start_time) / fit.seconds
    if output is not None:
        write_structured(output, motion_file.written(request))
    return planned, slower


def _plan_offline(
    fit: Fit,
    told: dict[str, Any],
    pace: Pace,
    config: Path | None,
    device: str,
    output: Path | None,
    *,
    as_json: bool,
) -> None:
    from orientd import planner
    from orientd.cli.commands.motion_commands import device_settings
    from orientd.daemon import plan_of

    settings = device_settings(config, device)
    start = planner.State.at_rest(fit.control[0])

    def plan(request: MotionRequest) -> planner.Motion:
        return planner.plan(
            request,
            start=start,
            limits=settings.limits.to_limits(),
            period=settings.period_ns * 1e-9,
        )

    motion, slower = _paced(fit, pace, plan, output)
    found = {"fit": told, "slower": slower, "plan": plan_of(motion), "output": output}
    answer(found, *_plan_lines(motion, slower, output), as_json=as_json)


def _move(
    fit: Fit,
    told: dict[str, Any],
    pace: Pace,
    device: str,
    lease: bool,
    socket: Path | None,
    output: Path | None,
    *,
    as_json: bool,
) -> None:
    from orientd.cli.commander import commander
    from orientd.cli.commands.motion_commands import follow, raise_unless_done, tell_motion

    with commander(socket, "replay", device, is_beside=lease) as robot:
        plan, slower = _paced(fit, pace, lambda request: robot.plan(request, device=device), output)
        if not as_json:
            say(*_plan_lines(plan, slower, output))
        handle = robot.move(plan, device=device)
        summary = follow(handle, title=f"motion {handle.motion_number}", is_silent=as_json)
    tell_motion(handle, summary, as_json=as_json, fit=told, slower=slower)
    raise_unless_done(summary)


def _plan_lines(planned: Any, slower: float, output: Path | None) -> list[str]:  # noqa: ANN401 - two kinds
    from orientd.cli import texts

    first = f"{slower:.3f} times as long as recorded"
    written = [] if output is None else [f"wrote {output}"]
    return [first, "", *texts.certificate(planned.certificate), *written]
