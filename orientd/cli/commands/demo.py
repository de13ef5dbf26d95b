"""`orientd demo`: a daemon, a device without hardware, and a motion that moves it."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from orientd.cli.command import check_picture
from orientd.cli.output import Output
from orientd.cli.own_daemon import recorded, simulated
from orientd.cli.parameters import Argument, Option
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd.protocol import control_pb2 as pb
    from orientd.stream.records import Cycle

RATE_HZ = 500
START_VELOCITY = (0.25, -0.1, 0.3)
END_VELOCITY = (-0.2, 0.15, 0.35)
"""Body frame, rad/s."""

# Rotation vectors in rad and positions in m, passed as fast as the limits permit.
KEYFRAMES = (
    ((0.0, 0.0, 0.0), (0.40, 0.00, 0.30)),
    ((0.5, -0.3, 0.4), (0.42, 0.10, 0.32)),
    ((0.2, 0.6, 1.1), (0.38, 0.20, 0.36)),
    ((-0.5, 0.4, 1.7), (0.32, 0.24, 0.34)),
    ((-0.3, -0.5, 2.2), (0.30, 0.16, 0.30)),
    ((0.3, -0.2, 2.6), (0.36, 0.06, 0.30)),
)

# Slower than the device could move: the demo should be watched for about ten seconds.
LIMITS = {"velocity": 0.9, "acceleration": 3.0, "jerk": 60.0, "linear_velocity": 0.2}


DEVICE = (
    f'driver = "loopback"\nrate_hz = {RATE_HZ}\noptions = {{position = {list(KEYFRAMES[0][1])}}}\n'
)
"""The table of its configuration."""


def demo(
    out: Output,
    what: Annotated[
        Literal["motion", "policy"],
        Argument(metavar="WHAT", help="`motion`; `policy` is now one of the examples."),
    ] = "motion",
    plot: Annotated[
        Path,
        Option(
            "--plot",
            "-p",
            help="Image file to draw (extra plot).",
        ),
    ] = Path("orientd-demo.png"),
) -> None:
    """Run a motion on a simulated device, and report how well it went.

    The command starts a daemon with a simulated device of its own, and ends it after the motion.
    The motion passes through six keyframes and has a velocity at both ends: a lead-in accelerates
    the device to the first keyframe, and a lead-out brings it to rest after the last.  All figures
    are measured from the setpoints that the driver got.
    """
    if what == "policy":
        raise OrientdError(
            "the demo of a policy is now an example: start `orientd run`, then in a clone of the "
            "sources `python examples/policy_chunks/play.py`"
        )
    from orientd import plots
    from orientd.cli import texts
    from orientd.cli.following import follow, raise_unless_done
    from orientd.client.robot import connect
    from orientd.protocol import control_pb2 as pb
    from orientd.stream.records import ServoState

    check_picture(plot)
    if not plot.absolute().parent.is_dir():
        raise OrientdError(f"cannot write {plot}: {os.strerror(errno.ENOENT)}")
    with simulated(DEVICE) as socket, connect(socket, holder="orientd demo") as robot:
        (device,) = robot.state().devices.values()
        out.say(
            f"device {device.name}: {device.driver} at {device.rate_hz:g} Hz, servo process "
            f"{device.servo_pid}, {device.scheduling}",
            f"motion: {len(KEYFRAMES)} keyframes, begins with {START_VELOCITY} rad/s, "
            f"ends with {END_VELOCITY} rad/s",
        )
        with recorded(robot) as cycles:
            handle = robot.move(
                [{"rotation_vector": turn, "position": place} for turn, place in KEYFRAMES],
                start_velocity=START_VELOCITY,
                end_velocity=END_VELOCITY,
                approach=True,
                limits=LIMITS,
            )
            summary = follow(handle, out, title="demo")
        plan = handle.plan
    moving = [cycle for cycle in cycles if cycle.state is ServoState.STREAMING]
    out.say("", *texts.summary(summary, plan))
    why_not = ""
    if summary.outcome != pb.OUTCOME_DONE:
        why_not = "none, since the motion did not run to its end"
    elif not plots.is_available():
        why_not = "none: pip install 'orientd-motion[plot]' for one"
    elif not moving:
        why_not = "none: no cycle of the motion was reported"
    else:
        _draw(plot, moving, plan)
    out.answer(
        {"plan": plan, "summary": summary, "picture": None if why_not else plot.absolute()},
        f"  picture              {why_not or plot.absolute()}",
    )
    raise_unless_done(summary)


def _draw(path: Path, moving: list[Cycle], plan: pb.Plan) -> None:
    """Draw the setpoints and their punctuality."""
    import numpy as np

    from orientd import plots, rotation

    period = 1.0 / RATE_HZ
    first = moving[0].path_index
    times = period * np.array(
        [(cycle.path_index - first + cycle.path_fraction) for cycle in moving]
    )
    q = np.array([cycle.q for cycle in moving])
    keyframe_times = np.array(plan.keyframe_times)
    nearest = np.clip(np.searchsorted(times, keyframe_times), 0, len(times) - 1)
    certificate = plan.certificate
    plots.draw_sent(
        path,
        plots.Traces(
            times=times,
            q=q,
            omega_body=np.array([cycle.omega_body for cycle in moving]),
            alpha_body=np.array([cycle.alpha_body for cycle in moving]),
            keyframe_times=keyframe_times,
            keyframe_q=q[nearest],
            velocity_limit=certificate.peak_velocity.limit,
            acceleration_limit=certificate.peak_acceleration.limit,
        ),
        plots.Timing(
            times=times,
            lateness=1e-9 * np.array([cycle.lateness_ns for cycle in moving]),
            tracking_error=np.where(
                [cycle.has_feedback for cycle in moving],
                rotation.angle(q, np.array([cycle.feedback_q for cycle in moving])),
                np.nan,
            ),
            period=period,
        ),
        title=f"orientd demo: {len(keyframe_times)} keyframes at {RATE_HZ} Hz, as sent",
    )
