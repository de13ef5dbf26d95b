"""What the page says, in plain words; nothing that others have written gets into it unescaped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from orientd.errors import Fault
from orientd.planner import Certificate, Peak
from orientd.rotation import to_euler
from orientd.rpc import DaemonReport, DeviceReport, titled
from orientd.stream import ServoState
from orientd.viewer.cell import Member
from orientd.viewer.freshness import SEEN, STATE

FAULTS = {
    Fault.NONE: "no fault",
    Fault.LINK_LOST: "The connection to the device is gone.",
    Fault.FEEDBACK_STALE: "The device has not said where it is for too long.",
    Fault.DEVICE_FAULT: "The device says that it cannot go on.",
    Fault.LIMIT_GUARD: "The next setpoint would have broken a limit, so it was not sent.",
    Fault.PATH_STARVED: "The path did not arrive in time.",
    Fault.HEARTBEAT_LOST: "The daemon was not heard of for too long.",
    Fault.SERVO_DIED: "The process that drives the device has ended.",
    Fault.INTERNAL: "There is an error in orientd itself.",
    Fault.SERVO_STALLED: "The process that drives the device stood still for too long.",
}

_STATES = {
    ServoState.IDLE: ("○", "Idle", "not enabled, nothing is sent"),
    ServoState.HOLDING: ("●", "Holding", "at rest, ready to move"),
    ServoState.STREAMING: ("▶", "Moving", ""),
    ServoState.STOPPING: ("▼", "Stopping", "coming to rest"),
    ServoState.FAULT: ("⚠", "Fault", "stopped; reset it once it is safe to"),
    ServoState.TRACKING: ("◎", "Tracking", "following targets"),
}


def state(device: DeviceReport) -> tuple[str, str, str]:
    """Return what a device is doing: a sign, a word, and what there is to add."""
    if device.state is ServoState.STREAMING:
        motion = titled(device.motion_number, device.motion_name)
        where = f"motion {motion}, {device.path_time:.1f} of {device.duration:.1f} s"
        sign, word = ("Ⅱ", "Paused") if device.is_paused else ("▶", "Moving")
        speed = "" if device.speed == 1.0 else f", at {100.0 * device.speed:.0f} % speed"
        return sign, word, where + speed
    if device.is_free:
        return "✋", "Free", "can be moved by hand, nothing is sent"
    sign, word, what = _STATES[device.state]
    if device.state is ServoState.HOLDING and device.speed != 1.0:
        what += f" at {100.0 * device.speed:.0f} % speed"
    return sign, word, what


def lease(device: DeviceReport, daemon: DaemonReport, *, is_ours: bool) -> str:
    """Return who may command a device."""
    if is_ours:
        return "held by this view"
    held = daemon.lease_of(device.name)
    # What it calls itself, and who that is as the daemon knows them.
    whose = f"{held.holder} ({held.identity})" if held.identity else held.holder
    return f"held by {whose}" if held.holder else "free"


def status(
    device: DeviceReport,
    daemon: DaemonReport,
    *,
    is_ours: bool,
    problem: str = "",
    is_connected: bool = True,
) -> str:
    """Return the head of the page, as HTML.

    Args:
        device: that is shown.
        daemon: whose it is.
        is_ours: whether this view holds the lease.
        problem: why what is shown is old; empty while it is not.
        is_connected: whether the daemon answers.
    """
    sign, word, more = state(device)
    lines = []
    if problem:
        # What it was doing is not what it does.
        sign, word, more = "?", "Unknown", f"{word.lower()} when last heard of"
        lines.append(_banner("✕ Out of date" if is_connected else "✕ Not connected", problem))
    head = f'<span style="font-size:1.35em;font-weight:700">{sign} {escape(word)}</span>'
    lines.append(f'<div class="{STATE}">{head} {escape(more)}</div>')
    if device.state is ServoState.FAULT:
        lines.append(_banner(f"⚠ {FAULTS[device.fault]}", device.fault_text))
    lines.append(
        _row("Device", f"{device.name} ({device.driver}, {device.rate_hz:g} Hz)")
        + _row("Lease", lease(device, daemon, is_ours=is_ours))
        + _row("Measured", measured(device))
        + where(device)
    )
    return _page(*lines)


def cell(members: Sequence[Member]) -> str:
    """Return who is there, what they do and how old that is, as HTML."""
    if not members:
        return trouble("There is no daemon of this cell.")
    lines = []
    for member in members:
        age = "" if member.age is None else _age(member)
        title = f"<b>{escape(member.daemon)}</b>"
        lines.append(f'<div style="display:flex;gap:0.5em;margin-top:0.6em">{title}{age}</div>')
        if member.problem:
            lines.append(_banner("✕ Out of date", f"{member.daemon} {member.problem}"))
        for device in member.devices:
            sign, word, more = state(device)
            if member.problem or device.is_stale:
                sign, word, more = "?", "Unknown", f"{word.lower()} when last heard of"
            what = f"{sign} <b>{escape(word)}</b> {escape(more)}"
            lines.append(_row(device.name, "", f'<span class="{STATE}">{what}</span>'))
            if device.state is ServoState.FAULT:
                lines.append(_banner(f"⚠ {FAULTS[device.fault]}", device.fault_text))
    return _page(*lines)


def _age(member: Member) -> str:
    """Return the age of what a daemon has said, in steps that a reader can follow."""
    age = member.age or 0.0
    text = "less than 0.3 s old" if age < 0.3 else f"{age:.1f} s old"
    if member.age_bound is not None and member.age_bound > 0.1:
        text += f" (±{member.age_bound:.1f} s)"
    return f'<span style="opacity:0.72">{text}</span>'


def where(device: DeviceReport) -> str:
    """Return the orientation that was sent and the one that was measured, in numbers, as HTML."""
    cycle = device.cycle
    if cycle is None:
        return ""
    rows = _orientation("Sent", cycle.q)
    if cycle.has_feedback:
        rows += _orientation("Measured", cycle.feedback_q)
    if cycle.joints:
        angles = " ".join(f"{math.degrees(angle):.2f}°" for angle in cycle.joints)
        rows += _row("Axes measured", angles)
    return rows


def _orientation(name: str, q: Sequence[float]) -> str:
    yaw, pitch, roll = np.degrees(to_euler(q, "ZYX"))
    quaternion = " ".join(f"{axis} {part:+.4f}" for axis, part in zip("wxyz", q, strict=True))
    angles = f"yaw {yaw:.2f}° pitch {pitch:.2f}° roll {roll:.2f}° (ZYX)"
    return _row(name, quaternion) + _row("", angles)


def measured(device: DeviceReport) -> str:
    """Return how long ago the device was measured, in steps that a reader can follow."""
    age = device.feedback_age
    if age is None:
        return "never"
    return "less than 0.1 s ago" if age < 0.1 else f"{age:.1f} s ago"


def trouble(problem: str) -> str:
    """Return the head of a page that has never had anything to show, as HTML."""
    return _page(_banner("✕ Not connected", problem))


def certificate(of: Certificate) -> str:
    """Return what a motion promises, as HTML."""
    rows = [
        ("Duration", f"{of.duration:.2f} s"),
        ("of it lead-in", f"{of.lead_in:.2f} s"),
        ("of it lead-out", f"{of.lead_out:.2f} s"),
        ("Velocity", peak(of.peak_velocity, "rad/s")),
        ("Acceleration", peak(of.peak_acceleration, "rad/s²")),
        ("Jerk", peak(of.peak_jerk, "rad/s³")),
    ]
    if of.peak_linear_velocity.value > 0.0:
        rows.append(("Linear velocity", peak(of.peak_linear_velocity, "m/s")))
        rows.append(("Linear accel.", peak(of.peak_linear_acceleration, "m/s²")))
    usual = min(of.usual_stop_time or of.stop_time, of.stop_time)
    rows.append(("A stop takes", f"about {usual:.2f} s, at most {of.stop_time:.2f} s"))
    for name, value, unit, limit, _ in of.figures:
        against = "" if limit is None else f" of {limit:.3g}"
        rows.append((name, f"{value:.3g}{against} {unit}"))
    notes = "".join(f"<div>{escape(note)}</div>" for note in of.notes)
    return _page("".join(_row(name, text) for name, text in rows), notes)


def peak(measured: Peak, unit: str) -> str:
    """Return a largest value against its limit.

    >>> peak(Peak(1.5, 0.25, 2.5), "rad/s")
    '1.5 of 2.5 rad/s (60 %)'
    """
    share = 100.0 * measured.value / measured.limit
    return f"{measured.value:.3g} of {measured.limit:.3g} {unit} ({share:.0f} %)"


def refusal(problem: str) -> str:
    """Return why something was not done, as HTML."""
    return _page(_banner("✕ Refused", problem))


def note(text: str) -> str:
    """Return a remark, as HTML."""
    return _page(f"<div>{escape(text)}</div>")


def _banner(title: str, text: str) -> str:
    style = "border:2px solid #c03a17;border-radius:4px;padding:0.3em 0.5em;margin:0.3em 0"
    return f'<div role="alert" style="{style}"><b>{escape(title)}</b><br>{escape(text)}</div>'


def _row(name: str, text: str, html: str = "") -> str:
    label = f'<span style="flex:0 0 7.2em;opacity:0.72">{escape(name)}</span>'
    return f'<div style="display:flex">{label}<span>{escape(text)}{html}</span></div>'


def _page(*lines: str) -> str:
    style = "padding:0 0.8em 0.5em;font-size:0.875em;line-height:1.45;overflow-wrap:anywhere"
    return f'<div class="{SEEN}" style="{style}">{"".join(lines)}</div>'
