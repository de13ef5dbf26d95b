"""Values in words: orientations, durations, certificates and summaries for people."""

from __future__ import annotations

import math
import time

from orientd.keep_out import KeepOut
from orientd.model.limits import ANGULAR, AXES, Rate
from orientd.one_line import counted
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import ending, last_ending, orientation, titled, word
from orientd.protocol.values import to_quaternion


def milliseconds(seconds: float) -> str:
    """Return a lateness.

    >>> milliseconds(0.0000521)
    '0.052 ms'
    """
    return f"{seconds * 1e3:.3f} ms"


def small_angle(radians: float | None) -> str:
    """Return a tracking error, which may not be known.

    >>> small_angle(0.0123), small_angle(None)
    ('12.30 mrad', 'unknown')
    """
    return "unknown" if radians is None else f"{radians * 1e3:.2f} mrad"


def clock(seconds: float) -> str:
    """Return how long something has lasted.

    >>> clock(3723.4)
    '1:02:03'
    """
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def state(device: pb.DeviceReport) -> str:
    """Return what a device is doing."""
    if device.state == pb.STATE_FAULT:
        return f"fault {word(device, 'fault')}: {device.fault_text}"
    if device.is_stale:
        last = word(device, "state")
        return f"unknown: no cycle for {device.cycle_age:.1f} s; {last} when last heard of"
    if device.is_paused:
        return "paused"
    if device.is_free:
        return "can be moved by hand"
    return word(device, "state")


def health(part: pb.PartHealth) -> str:
    """Return how a part of a device is, and how long ago that was measured.

    >>> health(pb.PartHealth(name="yaw", age=0.42, voltage=12.1, temperature=41.0, current=-0.25))
    '12.1 V, 41 degrees C, -0.25 A, 0.4 s ago'
    >>> health(pb.PartHealth(name="yaw", age=9.0, is_stale=True, temperature=75.0, warning="hot"))
    '75 degrees C, 9.0 s ago (stale); warning: hot'
    """
    forms = (("voltage", ".1f", "V"), ("temperature", ".0f", "degrees C"), ("current", ".2f", "A"))
    told = [
        f"{getattr(part, name):{form}} {unit}" for name, form, unit in forms if part.HasField(name)
    ]
    stale = " (stale)" if part.is_stale else ""
    warning = f"; warning: {part.warning}" if part.warning else ""
    return f"{', '.join([*told, f'{part.age:.1f} s ago'])}{stale}{warning}"


def age(seconds: float | None) -> str:
    """Return how long ago something was, if it was.

    >>> age(0.0021), age(3.21), age(None)
    ('2.1 ms ago', '3.2 s ago', 'never')
    """
    if seconds is None:
        return "never"
    return f"{seconds * 1e3:.1f} ms ago" if seconds < 1.0 else f"{seconds:.1f} s ago"


def peak(measured: pb.Peak | pb.Figure, unit: str) -> str:
    """Return a largest value against its limit.

    >>> peak(pb.Peak(value=1.5, time=0.25, limit=2.5), "rad/s")
    '1.5 of 2.5 rad/s (60.0 %) at 0.250 s'
    """
    return f"{_against(measured.value, measured, unit)} at {measured.time:.3f} s"


def _against(value: float, promised: pb.Peak | pb.Figure, unit: str) -> str:
    share = 100.0 * value / promised.limit
    return f"{value:.5g} of {promised.limit:.5g} {unit} ({share:.1f} %)"


def limit(rate: Rate) -> str:
    """Return a limit of a norm, or of the components in the body frame.

    >>> limit((2.0, 1.0, 3.5))
    '2/1/3.5'
    """
    return f"{rate:g}" if isinstance(rate, float | int) else "/".join(f"{r:g}" for r in rate)


_OF_BODY_AXES = {f"angular {name} about {axis}" for name in ANGULAR for axis in AXES}


def certificate(of: pb.Certificate) -> list[str]:
    """Return what a motion promises, line by line."""
    lines = [
        f"duration             {of.duration:.3f} s at {of.rate_hz:g} Hz",
        f"lead-in, lead-out    {of.lead_in:.3f} s, {of.lead_out:.3f} s",
        f"velocity             {peak(of.peak_velocity, 'rad/s')}",
        f"acceleration         {peak(of.peak_acceleration, 'rad/s^2')}",
        f"jerk                 {peak(of.peak_jerk, 'rad/s^3')}",
    ]
    lines += [
        f"{figure.name.removeprefix('angular '):<21}{peak(figure, figure.unit)}"
        for figure in of.figures
        if figure.name in _OF_BODY_AXES and figure.HasField("limit") and figure.HasField("time")
    ]
    lines += [
        f"{figure.name:<21}{math.degrees(abs(figure.value)):.2f} deg "
        f"{'inside' if figure.value < 0.0 else 'clear'} at {figure.time:.3f} s"
        for figure in of.figures
        if figure.name.startswith("keep-out ")
    ]
    if of.peak_linear_velocity.value > 0.0:
        lines += [
            f"linear velocity      {peak(of.peak_linear_velocity, 'm/s')}",
            f"linear acceleration  {peak(of.peak_linear_acceleration, 'm/s^2')}",
        ]
    lines += [
        f"end velocities       met to {of.start_velocity_error:.1e} and "
        f"{of.end_velocity_error:.1e} rad/s",
        *(
            ["control points       not passed"]
            if of.has_control_points
            else [f"keyframes            met to {of.keyframe_error:.1e} rad"]
        ),
        f"a stop on the path   {stop_time(of)}",
    ]
    lines += [f"target lost          {loss}" for loss in losses(of)]
    lines += [f"note                 {note}" for note in of.notes]
    return lines


def losses(of: pb.Certificate) -> list[str]:
    """Return when the axes of a gimbal do not point along the path, a line for each interval.

    >>> losses(pb.Certificate(losses=[pb.Loss(start=12.5, end=15.0, error=0.1)]))
    ['12.500 to 15.000 s (2.500 s), by up to 5.73 deg']
    """
    return [
        f"{one.start:.3f} to {one.end:.3f} s ({one.end - one.start:.3f} s), by up to "
        f"{math.degrees(one.error):.2f} deg"
        for one in of.losses
    ]


def stop_time(of: pb.Certificate) -> str:
    """Return how long a stop on the path usually takes, and at most."""
    most = f"{of.stop_time:.3f} s at the most"
    usual = of.usual_stop_time
    return f"about {usual:.3f} s, {most}" if 0.0 < usual < 0.999 * of.stop_time else most


def speed_left(speed: float) -> list[str]:
    """Return a line about a speed that was left by whoever set it; none where it is as planned.

    >>> speed_left(1.0), speed_left(0.5)
    ([], ['runs at speed 0.5, as it was set before; `orientd speed 1` is as planned'])
    """
    said = f"runs at speed {speed:g}, as it was set before; `orientd speed 1` is as planned"
    return [] if speed == 1.0 else [said]


def summary(of: pb.MoveSummary, plan: pb.Plan, *, speed: float = 1.0) -> list[str]:
    """Return how a motion went that began at a *speed*, line by line."""
    lines = [f"motion {titled(of.motion_number, plan.name)}: {ending(of)}"]
    if speed != 1.0:
        lines.append(f"  speed                {speed:g} when it began, as it was set before")
    if of.HasField("statistics"):
        lines += [f"  {line}" for line in statistics(of.statistics, plan)]
    if of.HasField("settled_after"):
        lines.append(f"  on target            {of.settled_after:.3f} s after the last setpoint")
    if of.HasField("start_lateness"):
        skew = f", {milliseconds(of.start_skew)} skew" if of.HasField("start_skew") else ""
        lines.append(f"  begun                {milliseconds(of.start_lateness)} late{skew}")
    return lines


def statistics(of: pb.MotionStatistics, plan: pb.Plan) -> list[str]:
    """Return what was measured of a motion, against what it promised."""
    late, limits = of.lateness, plan.certificate
    errors = [
        f"off by {getattr(of, name):.1e} rad/s at the {end}"
        for end in ("start", "end")
        if of.HasField(name := f"{end}_velocity_error")
    ]
    percentiles = " / ".join(f"{1e3 * part:.3f}" for part in (late.p50, late.p99, late.p99_9))

    stalls = f"{counted(of.stalls, 'time')}, as the servo process did not run: see `orientd doctor`"
    return [
        f"cycles               {of.cycles}, {counted(of.overruns, 'overrun')}, {of.missed} missed",
        *([f"on from rest         {stalls}"] if of.stalls else []),
        f"lateness             {percentiles} / {milliseconds(late.largest)} "
        "(p50 / p99 / p99.9 / max)",
        f"velocity sent        {_against(of.velocity, limits.peak_velocity, 'rad/s')}",
        f"acceleration sent    {_against(of.acceleration, limits.peak_acceleration, 'rad/s^2')}",
        f"jerk sent            {_against(of.jerk, limits.peak_jerk, 'rad/s^3')}",
        f"error to the plan    {of.path_error:.1e} rad at the most",
        *([f"end velocities       {', '.join(errors)}"] if errors else []),
        f"tracking error       {small_angle(of.tracking_error)} at the most",
    ]


def motion(device: pb.DeviceReport) -> str:
    """Return which motion a device runs, or ran last."""
    if device.motion_number == 0:
        return "none yet" if device.speed == 1.0 else f"none yet; speed {device.speed:g} is set"
    of = titled(device.motion_number, device.motion_name)
    running = f"{of}: {device.path_time:.3f} of {device.duration:.3f} s"
    return f"{last_ending(device) or running}, speed {device.speed:g}"


def device(of: pb.DeviceReport) -> list[str]:
    """Return what a device is and does, line by line."""
    memory = "memory locked" if of.is_memory_locked else "memory not locked"
    servo = f"process {of.servo_pid}, {of.scheduling}, {memory}"
    lines = [
        f"{of.name}  {of.driver} at {of.rate_hz:g} Hz: {state(of)}",
        f"  servo        {servo if of.servo_pid else 'none'}",
        f"  motion       {motion(of)}",
    ]
    if of.HasField("cycle"):
        cycle = of.cycle
        error = cycle.tracking_error if cycle.HasField("tracking_error") else None
        measured = of.feedback_age if of.HasField("feedback_age") else None
        lines += [
            f"  orientation  {orientation(to_quaternion(cycle.q))}",
            f"  cycle        {cycle.index}: {age(of.cycle_age)}, late "
            f"{milliseconds(cycle.lateness_ns * 1e-9)}, {counted(cycle.overruns, 'overrun')}, "
            f"{cycle.missed} missed, tracking {small_angle(error)}",
            f"  measured     {age(measured)}",
        ]
    if of.keep_out:
        # Reading cones loads the model, which takes a tenth of a second.
        from orientd.protocol.cones import to_cones

        lines += [f"  keep-out     {cone(one)}" for one in to_cones(of.keep_out)]
    if of.held_at:
        lines.append(f"  target       held at the edge of the keep-out cone {of.held_at!r}")
    return lines + [f"  {part.name:<11}  {health(part)}" for part in of.health]


def cone(of: KeepOut) -> str:
    """Return a keep-out cone: its name, size and present direction.

    >>> cone(KeepOut("laser", (0.0, 1.0, 0.0), math.radians(12.0)))
    'laser: 12 deg around azimuth 90.0, elevation 0.0 deg'
    """
    x, y, z = of.direction_at(time.time_ns())
    azimuth, elevation = math.degrees(math.atan2(y, x)), math.degrees(math.asin(z))
    size = f"{math.degrees(of.half_angle):g} deg"
    if of.margin:
        size += f" and a margin of {math.degrees(of.margin):g} deg"
    return f"{of.name}: {size} around azimuth {azimuth:.1f}, elevation {elevation:.1f} deg"
