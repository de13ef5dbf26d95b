"""What the page says, in plain words.

A line is a kind and two texts.  ``current`` lines are hidden once they are old, ``row`` lines are a
name and a value, ``alert`` lines stand out, and ``note`` lines have one text.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orientd.errors import Fault
from orientd.planner import Certificate, Peak
from orientd.rotation import to_euler
from orientd.rpc import DaemonReport, DeviceReport, titled
from orientd.stream import ServoState
from orientd.viewer.cell import Member

Line = tuple[str, str, str]

FAULTS = {
    Fault.NONE: "No fault.",
    Fault.LINK_LOST: "The connection to the device is lost.",
    Fault.FEEDBACK_STALE: "The device has not reported its position for too long.",
    Fault.DEVICE_FAULT: "The device reports a fault.",
    Fault.LIMIT_GUARD: "The next setpoint would have exceeded a limit, so it was not sent.",
    Fault.PATH_STARVED: "The path did not arrive in time.",
    Fault.HEARTBEAT_LOST: "The servo did not hear from the daemon for too long.",
    Fault.SERVO_DIED: "The servo process has ended.",
    Fault.INTERNAL: "There is an error in orientd itself.",
    Fault.SERVO_STALLED: "The servo process stood still for too long.",
}

_STATES = {
    ServoState.IDLE: ("○ Idle", "not enabled, nothing is sent"),
    ServoState.HOLDING: ("● Holding", "at rest, ready to move"),
    ServoState.STREAMING: ("▶ Moving", ""),
    ServoState.STOPPING: ("▼ Stopping", "coming to rest"),
    ServoState.FAULT: ("⚠ Fault", "stopped; reset it once it is safe to"),
    ServoState.TRACKING: ("◎ Tracking", "following targets"),
}


def state(device: DeviceReport) -> tuple[str, str]:
    """Return what a device does: a sign with a word, and what there is to add."""
    at_speed = "" if device.speed == 1.0 else f" at {100.0 * device.speed:.0f} % speed"
    if device.state is ServoState.STREAMING:
        motion = titled(device.motion_number, device.motion_name)
        where = f"motion {motion}, {device.path_time:.1f} of {device.duration:.1f} s"
        return "Ⅱ Paused" if device.is_paused else "▶ Moving", where + at_speed
    if device.is_free:
        return "✋ Free", "can be moved by hand, nothing is sent"
    word, more = _STATES[device.state]
    return word, more + (at_speed if device.state is ServoState.HOLDING else "")


def current(device: DeviceReport, *, is_known: bool) -> Line:
    """Return what a device does, or did if that *is_known* no more."""
    word, more = state(device)
    if not is_known:
        word, more = "? Unknown", f"{word[2:].lower()} when last heard of"
    return "current", word, more


def status(
    device: DeviceReport, daemon: DaemonReport, *, is_ours: bool, problem: str, is_connected: bool
) -> list[Line]:
    """Return the head of the page.

    Args:
        device: the one that is shown.
        daemon: the one it belongs to.
        is_ours: whether this view holds the lease.
        problem: why this is out of date; empty while it is not.
        is_connected: whether the daemon answers.
    """
    lines = []
    if problem:
        lines.append(("alert", "✕ Out of date" if is_connected else "✕ Not connected", problem))
    lines.append(current(device, is_known=not problem))
    if device.state is ServoState.FAULT:
        lines.append(("alert", f"⚠ {FAULTS[device.fault]}", device.fault_text))
    return [
        *lines,
        ("row", "Device", f"{device.name} ({device.driver}, {device.rate_hz:g} Hz)"),
        ("row", "Lease", lease(device, daemon, is_ours=is_ours)),
        ("row", "Measured", measured(device)),
        *where(device),
    ]


def lease(device: DeviceReport, daemon: DaemonReport, *, is_ours: bool) -> str:
    """Return who may command a device."""
    if is_ours:
        return "held by this view"
    held = daemon.lease_of(device.name)
    whose = f"{held.holder} ({held.identity})" if held.identity else held.holder
    return f"held by {whose}" if held.holder else "free"


def measured(device: DeviceReport) -> str:
    """Return how long ago the device was measured, in steps that a reader can follow."""
    age = device.feedback_age
    if age is None:
        return "never"
    return "less than 0.1 s ago" if age < 0.1 else f"{age:.1f} s ago"


def where(device: DeviceReport) -> list[Line]:
    """Return the orientation that was sent, and the one that was measured, in numbers."""
    cycle = device.cycle
    if cycle is None:
        return []
    lines = _orientation("Sent", cycle.q)
    if cycle.has_feedback:
        lines += _orientation("Measured", cycle.feedback_q)
    if cycle.joints:
        angles = " ".join(f"{math.degrees(angle):.2f}°" for angle in cycle.joints)
        lines.append(("row", "Axes measured", angles))
    return lines


def _orientation(name: str, q: Sequence[float]) -> list[Line]:
    yaw, pitch, roll = np.degrees(to_euler(q, "ZYX"))
    quaternion = " ".join(f"{axis} {part:+.4f}" for axis, part in zip("wxyz", q, strict=True))
    angles = f"yaw {yaw:.2f}° pitch {pitch:.2f}° roll {roll:.2f}° (ZYX)"
    return [("row", name, quaternion), ("row", "", angles)]


def cell(members: Sequence[Member]) -> list[Line]:
    """Return the daemons of a cell, what their devices do, and how old that is."""
    if not members:
        return [("alert", "✕ Not connected", "There is no daemon in this cell.")]
    lines: list[Line] = []
    for member in members:
        lines.append(("title", member.daemon, _age(member)))
        if member.problem:
            lines.append(("alert", "✕ Out of date", f"{member.daemon} {member.problem}"))
        for device in member.devices:
            is_known = not (member.problem or device.is_stale)
            _, word, more = current(device, is_known=is_known)
            lines.append(("current", f"{device.name}: {word}", more))
            if device.state is ServoState.FAULT:
                lines.append(("alert", f"⚠ {FAULTS[device.fault]}", device.fault_text))
    return lines


def _age(member: Member) -> str:
    """Return the age of what a daemon has said, in steps that a reader can follow."""
    if member.age is None:
        return ""
    text = "less than 0.3 s old" if member.age < 0.3 else f"{member.age:.1f} s old"
    is_vague = member.age_bound is not None and member.age_bound > 0.1
    return f"{text} (±{member.age_bound:.1f} s)" if is_vague else text


def certificate(of: Certificate) -> list[Line]:
    """Return what a motion promises."""
    usual = min(of.usual_stop_time or of.stop_time, of.stop_time)
    rows = [
        ("Duration", f"{of.duration:.2f} s"),
        ("Lead-in", f"{of.lead_in:.2f} s"),
        ("Lead-out", f"{of.lead_out:.2f} s"),
        ("Velocity", peak(of.peak_velocity, "rad/s")),
        ("Acceleration", peak(of.peak_acceleration, "rad/s²")),
        ("Jerk", peak(of.peak_jerk, "rad/s³")),
    ]
    if of.peak_linear_velocity.value > 0.0:
        rows.append(("Linear velocity", peak(of.peak_linear_velocity, "m/s")))
        rows.append(("Linear accel.", peak(of.peak_linear_acceleration, "m/s²")))
    rows.append(("A stop takes", f"about {usual:.2f} s, at most {of.stop_time:.2f} s"))
    for name, value, unit, limit, _ in of.figures:
        against = "" if limit is None else f" of {limit:.3g}"
        rows.append((name, f"{value:.3g}{against} {unit}"))
    return [("row", *row) for row in rows] + [("note", note, "") for note in of.notes]


def peak(measured: Peak, unit: str) -> str:
    """Return a largest value against its limit.

    >>> peak(Peak(1.5, 0.25, 2.5), "rad/s")
    '1.5 of 2.5 rad/s (60 %)'
    """
    share = 100.0 * measured.value / measured.limit
    return f"{measured.value:.3g} of {measured.limit:.3g} {unit} ({share:.0f} %)"
