"""Show a motion until it has ended, and conclude the command that began it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from orientd.cli.output import Output
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd.client.endless_turn import EndlessTurn
    from orientd.client.move_handle import MoveHandle
    from orientd.protocol import control_pb2 as pb

CANCEL_TIMEOUT = 15.0
"""Time for a cancelled motion to come to rest, s."""


def follow(
    handle: MoveHandle | EndlessTurn, out: Output, *, title: str, lines: Iterable[str] = ()
) -> pb.MoveSummary:
    """Show a motion until it has ended; Ctrl-C stops it on its path.

    Raises:
        OrientdError: the daemon was lost, or the motion did not come to rest.
    """
    from orientd.cli import progress, texts

    try:
        out.say(*lines, *texts.speed_left(handle.speed))
        with progress.view(title, out) as show:
            for report in handle:
                show(report)
        return handle.wait(check=False)
    except KeyboardInterrupt:
        handle.cancel()
        try:
            return handle.wait(CANCEL_TIMEOUT, check=False)
        except TimeoutError as error:
            raise OrientdError(str(error)) from error


def conclude(
    handle: MoveHandle | EndlessTurn, summary: pb.MoveSummary, out: Output, **more: object
) -> None:
    """Print the result of a motion, with *more* for programs.

    Raises:
        OrientdError: it was not run to its end.
    """
    from orientd.cli import texts

    moved = {"plan": handle.plan, "summary": summary, "speed": handle.speed}
    lines = texts.summary(summary, handle.plan, speed=handle.speed)
    out.answer({**more, **moved}, *lines)
    raise_unless_done(summary)


def raise_unless_done(summary: pb.MoveSummary) -> None:
    """Raise the error of a command whose motion was not run to its end."""
    from orientd.protocol.reports import GOOD_OUTCOMES
    from orientd.protocol.reports import ending as how

    if summary.outcome not in GOOD_OUTCOMES:
        raise OrientdError(f"motion {summary.motion_number} {how(summary)}")
