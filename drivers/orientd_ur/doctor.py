"""Findings of `orientd doctor` about a robot, each with its remedy."""

from __future__ import annotations

from importlib import metadata

from orientd.driver import Finding, Verdict
from orientd.errors import LinkError
from orientd_ur import controller
from orientd_ur.controller import NO_DASHBOARD, obstacle
from orientd_ur.options import REGISTERS, UrOptions
from orientd_ur.probe import Probe, look
from orientd_ur.robot import Robot

_PACKAGES = 100


def inspect(options: UrOptions, period_ns: int, *, timeout: float = 2.0) -> list[Finding]:
    """Inspect the robot at ``options.host``; nothing on it changes.

    Args:
        options: of the driver.
        period_ns: time between two setpoints.
        timeout: s for each answer of the robot.
    """
    robot = Robot(options)
    first = REGISTERS[options.registers]
    try:
        found = look(robot.address, timeout=timeout, packages=_PACKAGES, first_register=first)
    except LinkError as error:
        mend = (
            "power the robot, check address and cable, enable RTDE, dashboard server and "
            "secondary clients under Settings > Security > Services"
        )
        return [_library(), Finding("reachability", str(error), Verdict.PROBLEM, mend)]
    return [
        _library(),
        Finding("reachability", f"{options.host} answers on every port", Verdict.OK),
        _judged(
            "version",
            controller.software(found.version),
            controller.version_problem(found.version),
        ),
        _rate(found, period_ns),
        _arm(robot, is_needed=options.check_joints),
        _remote_control(found, is_needed=options.check_remote_control),
        _readiness(found),
        _registers(found),
        _link(found),
    ]


def _judged(name: str, found: str, mend: str) -> Finding:
    """Return a finding that is a problem if it has a remedy."""
    return Finding(name, found, Verdict.PROBLEM if mend else Verdict.OK, mend)


def _library() -> Finding:
    try:
        return _judged("client library", f"ur-rtde {metadata.version('ur-rtde')}", "")
    except metadata.PackageNotFoundError:
        mend = "pip install 'orientd-motion[ur]'"
        return _judged("client library", "ur-rtde is not installed", mend)


def _rate(found: Probe, period_ns: int) -> Finding:
    mend = controller.rate_problem(found.version, period_ns)
    return _judged("rate", f"{1e9 / period_ns:g} Hz", mend and f"the robot {mend}")


def _arm(robot: Robot, *, is_needed: bool) -> Finding:
    try:
        arm, _ = robot.look()
    except LinkError as error:
        mend = "see above; motions are refused as long as the joints cannot be predicted"
        return _judged("arm", str(error), mend if is_needed else "")
    is_calibrated = arm.kinematics.is_calibrated
    how = "its own calibration" if is_calibrated else "the published lengths"
    return _judged("arm", f"{arm.name}, by {how}", "")


def _remote_control(found: Probe, *, is_needed: bool) -> Finding:
    name = "remote control"
    if not controller.has("a dashboard server", found.version):
        return Finding(name, "not known", Verdict.IMPROVE, NO_DASHBOARD)
    if not controller.has("is in remote control", found.version):
        return _judged(name, f"{controller.software(found.version)} does not say", "")
    if found.is_remote is None:
        mend = "look at the icon at the top right of the pendant: the robot does not say"
        return Finding(name, "not known", Verdict.IMPROVE, mend)
    if found.is_remote or not is_needed:
        return _judged(name, "on" if found.is_remote else "off, and not insisted on", "")
    mend = (
        "switch to remote control with the icon at the top right of the pendant; it is enabled "
        "under Settings > System > Remote Control"
    )
    return _judged(name, "off", mend)


def _readiness(found: Probe) -> Finding:
    reason = obstacle(found.robot_mode, found.safety_mode)
    mend = "clear it on the pendant, or `orientd reset`" if reason else ""
    return _judged("readiness", reason or "powered, brakes released, no stop", mend)


def _registers(found: Probe) -> Finding:
    if found.registers_are_free:
        return _judged("registers", "free", "")
    mend = (
        "end the client that holds them: a daemon that runs with this robot, another program with "
        "ur_rtde, or a fieldbus enabled in the installation; or set the option `registers` to the "
        "other range"
    )
    return _judged("registers", "held by another client", mend)


def _link(found: Probe) -> Finding:
    text = (
        f"round trip {1e3 * found.round_trip:.2f} ms, jitter {1e3 * found.jitter:.2f} ms in "
        f"{_PACKAGES} packages"
    )
    worst, tick = max(found.round_trip, found.jitter), controller.tick_ns(found.version) * 1e-9
    if worst <= tick:
        return _judged("link", text, "")
    verdict = Verdict.IMPROVE if worst <= 5.0 * tick else Verdict.PROBLEM
    mend = "a cable of its own from this machine to the robot, no wireless and no busy switch"
    return Finding("link", text, verdict, mend)
