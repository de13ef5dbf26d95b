"""Write the texts of the page.

A line is a kind and two texts.  ``current`` lines are hidden once they are old.  ``row`` lines are
a name and a value, and ``age`` lines are rows that are hidden once they are old.  ``alert`` lines
stand out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.errors import Fault
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import last_ending, orientation, titled
from orientd.protocol.values import to_quaternion
from orientd.rotation import to_euler

Line = tuple[str, str, str]

FAULTS: dict[int, str] = {
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

_STATES: dict[int, tuple[str, str]] = {
    pb.STATE_IDLE: ("○ Idle", "not enabled, nothing is sent"),
    pb.STATE_HOLDING: ("● Holding", "at rest, ready to move"),
    pb.STATE_STREAMING: ("▶ Moving", ""),
    pb.STATE_STOPPING: ("▼ Stopping", "coming to rest"),
    pb.STATE_FAULT: ("⚠ Fault", "stopped; reset it once it is safe to"),
    pb.STATE_TRACKING: ("◎ Tracking", "following targets"),
}


def state(device: pb.DeviceReport) -> tuple[str, str]:
    """Return what a device does: a sign with a word, and what there is to add."""
    at_speed = "" if device.speed == 1.0 else f" at {100.0 * device.speed:.0f} % speed"
    if device.state == pb.STATE_STREAMING:
        motion = titled(device.motion_number, device.motion_name)
        where = f"motion {motion}, {device.path_time:.1f} of {device.duration:.1f} s"
        return "Ⅱ Paused" if device.is_paused else "▶ Moving", where + at_speed
    if device.is_free:
        return "✋ Free", "can be moved by hand, nothing is sent"
    word, more = _STATES[device.state]
    return word, more + (at_speed if device.state == pb.STATE_HOLDING else "")


def current(device: pb.DeviceReport, *, is_known: bool) -> Line:
    """Return what a device does, or did if that *is_known* no more."""
    word, more = state(device)
    if not is_known:
        word, more = "? Unknown", f"{word[2:].lower()} when last heard of"
    return "current", word, more


def status(
    device: pb.DeviceReport,
    daemon: pb.DaemonReport,
    *,
    is_ours: bool,
    problem: str,
    is_connected: bool,
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
    if device.state == pb.STATE_FAULT:
        lines.append(("alert", f"⚠ {FAULTS[device.fault]}", device.fault_text))
    return [
        *lines,
        ("row", "Device", f"{device.name} ({device.driver}, {device.rate_hz:g} Hz)"),
        *([("row", "Last motion", ended)] if (ended := last_ending(device)) else []),
        ("row", "Lease", lease(device, daemon, is_ours=is_ours)),
        ("age", "Last measured", measured(device)),
        *where(device),
    ]


def lease(device: pb.DeviceReport, daemon: pb.DaemonReport, *, is_ours: bool) -> str:
    """Return who may command a device."""
    if is_ours:
        return "held by this view"
    leases = (lease for lease in daemon.leases if device.name in lease.devices)
    held = next(leases, pb.LeaseReport())
    whose = f"{held.holder} ({held.identity})" if held.identity else held.holder
    return f"held by {whose}" if held.holder else "free"


def measured(device: pb.DeviceReport) -> str:
    """Return how long ago the device was measured, in steps that a reader can follow."""
    if not device.HasField("feedback_age"):
        return "never"
    age = device.feedback_age
    return "less than 0.1 s ago" if age < 0.1 else f"{age:.1f} s ago"


def where(device: pb.DeviceReport) -> list[Line]:
    """Return the orientation that was sent, and the one that was measured, in numbers."""
    if not device.HasField("cycle"):
        return []
    lines = _orientation("Sent", to_quaternion(device.cycle.q))
    if device.cycle.HasField("feedback_q"):
        lines += _orientation("Measured", to_quaternion(device.cycle.feedback_q))
    return lines


def _orientation(name: str, q: Sequence[float]) -> list[Line]:
    yaw, pitch, roll = np.degrees(to_euler(q, "ZYX"))
    angles = f"yaw {yaw:.2f}° pitch {pitch:.2f}° roll {roll:.2f}° (ZYX)"
    # A line never ends between the name of a component and its number.
    numbers = (
        orientation(q).replace(" +", "\N{NO-BREAK SPACE}+").replace(" -", "\N{NO-BREAK SPACE}-")
    )
    return [("row", name, numbers), ("row", "", angles)]
