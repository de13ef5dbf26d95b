"""Replay: a recorded orientation, fitted, planned and moved."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from orientd.cli.command import (
    Commander,
    ConfigFile,
    Partial,
    Topic,
    check_ending,
    device_settings,
    need_extra,
)
from orientd.cli.output import Output, working
from orientd.cli.parameters import Argument, Option, command
from orientd.errors import naming
from orientd.one_line import counted

if TYPE_CHECKING:
    from collections.abc import Callable

    from orientd.curves.fitting import Fit
    from orientd.model.request import MotionRequest
    from orientd.protocol import control_pb2 as pb
    from orientd_replay.orientations import Orientations


Pace = Literal["recorded", "minimum"]
"""Speed of a replay."""


@command
def replay(
    to: Commander,
    out: Output,
    file: Annotated[
        Path,
        Argument(
            metavar="RECORDING",
            help="A .mcap file (of orientd or not), a .csv file (also of EuRoC), a TUM trajectory "
            "(.tum, .txt), or a ROS 2 bag: its folder or .db3 file.",
        ),
    ],
    topic: Topic = "",
    partial: Partial = False,
    error: Annotated[
        float, Option(metavar="DEGREES", help="Largest deviation from the filtered samples.")
    ] = 1.0,
    pace: Annotated[
        Pace,
        Option(
            help="As recorded (slower if the limits require it), or as fast as they permit.",
        ),
    ] = "recorded",
    output: Annotated[
        Path | None,
        Option("--output", "-o", help="Write the motion file (.json), for `orientd move`."),
    ] = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Only plan; needs no daemon and moves nothing.")
    ] = False,
    config: ConfigFile = None,
) -> None:
    """Repeat a recorded motion.

    orientd fits a spline to the orientations, and shows the certificate before anything moves.  The
    fit handles noise, sign flips, outliers and gaps.  The motion begins with a lead-in from the
    current orientation.
    """
    need_extra("record")
    from orientd.cli.following import conclude, follow
    from orientd.curves.fitting import fit_orientations
    from orientd_replay.orientations import read_orientations

    if not 0.0 < error < 180.0:
        raise click.BadParameter(
            f"expected more than 0 and less than 180 degrees, got {error:g}", param_hint="--error"
        )
    if output is not None:
        check_ending(output, [".json"], named="--output")
    with working(f"reading {file}"):
        found = read_orientations(file, topic, partial=partial)
    with working(f"fitting {len(found.times)} samples"), naming(str(file)):
        fit = fit_orientations(found.times, found.q, tolerance=math.radians(error))
    fitted = _figures(found, fit)
    out.say(
        *(f"note: {note}" for note in fitted["notes"]),
        f"{fitted['topic'] or 'orientation'}: {counted(fitted['samples'], 'sample')} in "
        f"{fitted['seconds']:.2f} s by {fitted['clock']}, noise {fitted['noise_deg']:.3f} deg, "
        f"{fitted['left_out']} left out",
        f"spline with {counted(fitted['knots'], 'knot')}, at most {fitted['error_deg']:.3f} deg "
        "from the filtered samples",
    )
    if dry_run:
        from orientd.daemon.planners.reporting import plan_of

        planner = device_settings(config, to.device).planner()
        motion, slower = _planned(fit, pace, planner.plan_offline, output)
        planned = plan_of(motion)
        out.answer(
            {"fit": fitted, "slower": slower, "plan": planned, "output": output},
            *_lines(planned, slower, output),
        )
        return
    with to.connect("replay") as robot:
        plan, slower = _planned(fit, pace, lambda one: robot.plan(one, device=to.device), output)
        out.say(*_lines(plan, slower, output))
        handle = robot.move(plan, device=to.device)
        summary = follow(handle, out, title=f"motion {handle.motion_number}")
    conclude(handle, summary, out, fit=fitted, slower=slower)


def _figures(found: Orientations, fit: Fit) -> dict[str, Any]:
    """Return the quality of the fit."""
    return {
        "topic": found.topic,
        "clock": found.clock,
        "samples": len(fit.samples.times),
        "left_out": fit.samples.left_out,
        "seconds": fit.seconds,
        "noise_deg": math.degrees(fit.samples.noise),
        "knots": fit.knot_count,
        "error_deg": math.degrees(fit.error),
        "notes": found.notes,
    }


def _planned(
    fit: Fit, pace: Pace, plan: Callable[[MotionRequest], Any], output: Path | None
) -> tuple[Any, float]:
    """Plan the replay, and write its motion file; return the plan and its factor of the duration.

    Raises:
        OrientdError: it cannot be planned, or the file cannot be written.
    """
    from orientd import motion_file
    from orientd.planner.task import plan_as_recorded, replay_request
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


def _lines(planned: pb.Plan, slower: float, output: Path | None) -> list[str]:
    from orientd.cli import texts

    first = f"{slower:.3f} times as long as recorded"
    written = [] if output is None else [f"wrote {output}"]
    return [first, "", *texts.certificate(planned.certificate), *written]
