"""`orientd track`: follow targets that arrive on standard input."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Annotated, Any

import typer

from orientd.cli.command import AsJson, Beside, DeviceName, Socket, command
from orientd.cli.output import answer
from orientd.errors import RequestError

_KEYS = ("angular_velocity", "velocity_frame", "time_ns", "time_to_live", "position")


@command
def track(
    device: DeviceName = "",
    time_to_live: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="How long a target counts that does not say so."),
    ] = 0.5,
    lease: Beside = False,
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Follow targets that arrive on standard input.

    Each is one JSON object on one line; the device comes to rest when there are no more.
    A target has an orientation as in a motion file, and may have `angular_velocity` (rad/s) with
    `velocity_frame`, `position` (m), `time_ns` (monotonic clock) and `time_to_live` (s):

    {"rotation_vector": [0, 0, 0.3], "angular_velocity": [0, 0, 1], "time_to_live": 0.2}
    """
    from orientd.cli import texts
    from orientd.cli.shared_lease import commander

    with commander(socket, "track", device, is_beside=lease, is_shared=True) as robot:
        with robot.track(device=device) as tracking:
            for target, options in _targets():
                tracking.aim(target, **{"time_to_live": time_to_live, **options})
        report = tracking.report
    answer(
        report,
        f"{report.targets} targets followed, {report.left_out} of them left out as late, "
        f"{report.refused} refused",
        f"at rest at {texts.orientation(report.q)}",
        *([f"last refusal: {report.refusal}"] if report.refusal else []),
        as_json=as_json,
    )


def _targets() -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield the orientation and the options of every line.

    Raises:
        RequestError: a line is not a JSON object.
    """
    for number, line in enumerate(sys.stdin, 1):
        if not line.strip():
            continue
        try:
            mapping = json.loads(line)
        except ValueError:
            mapping = None
        if not isinstance(mapping, dict):
            raise RequestError(f"line {number}", f"expected a JSON object, got {line.strip()!r}")
        options = {key: mapping.pop(key) for key in _KEYS if key in mapping}
        yield mapping, options
