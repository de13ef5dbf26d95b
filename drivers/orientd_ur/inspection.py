"""What `orientd doctor` says of a robot: each look is a finding with what to do about it."""

from __future__ import annotations

from importlib import metadata

from orientd.driver import Finding, Verdict
from orientd.errors import LinkError
from orientd_ur import versions
from orientd_ur.options import REGISTERS, UrOptions
from orientd_ur.prediction import Prediction
from orientd_ur.probe import Probe, look
from orientd_ur.recovery import NO_DASHBOARD
from orientd_ur.sockets import Address
from orientd_ur.states import obstacle
from orientd_ur.ticks import tick_ns

_PACKAGES = 100


def inspect(options: UrOptions, period_ns: int, *, timeout: float = 2.0) -> list[Finding]:
    """Look at the robot at ``options.host``; nothing on it is changed.

    Args:
        options: of the driver.
        period_ns: from one setpoint to the next.
        timeout: s that each answer of the robot may take.
    """
    library = [_library()]
    try:
        address = Address(options.host).get(timeout)
        first = REGISTERS[options.registers]
        found = look(address, timeout=timeout, packages=_PACKAGES, first_register=first)
    except LinkError as error:
        return [
            *library,
            Finding(
                "reachability",
                str(error),
                Verdict.PROBLEM,
                "power the robot, check address and cable, enable RTDE, dashboard server and "
                "secondary clients under Settings > Security > Services",
            ),
        ]
    return [
        *library,
        Finding("reachability", f"{options.host} answers on every port", Verdict.OK),
        _version(found),
        _rate(found, period_ns),
        _arm(options),
        _remote_control(found, is_needed=options.check_remote_control),
        _readiness(found),
        _registers(found),
        _link(found),
    ]


def advice(version: tuple[int, ...], options: UrOptions) -> tuple[str, ...]:
    """Return what motions will be refused for, in words."""
    if not options.check_joints or options.tcp_offset is not None:
        return ()
    if versions.has("tcp_offset", version):
        return ()
    return (
        f"{versions.name(version)} does not say its TCP offset, without which the joints of a "
        "motion cannot be predicted: motions are refused until the option `tcp_offset` is set",
    )


def _library() -> Finding:
    try:
        return Finding("client library", f"ur-rtde {metadata.version('ur-rtde')}", Verdict.OK)
    except metadata.PackageNotFoundError:
        return Finding(
            "client library",
            "ur-rtde is not installed",
            Verdict.PROBLEM,
            "pip install 'orientd-motion[ur]'",
        )


def _version(found: Probe) -> Finding:
    text = versions.name(found.version)
    if found.version_problem:
        return Finding("version", text, Verdict.PROBLEM, found.version_problem)
    return Finding("version", text, Verdict.OK)


def rate_problem(version: tuple[int, ...], period_ns: int) -> str:
    """Return why a robot takes no setpoint every *period_ns*; nothing where it does."""
    cycle_ns = tick_ns(version)
    if period_ns >= cycle_ns:
        return ""
    return (
        f"takes a setpoint every {cycle_ns * 1e-6:g} ms: `rate_hz` must be {1e9 / cycle_ns:g} at "
        "the most"
    )


def _rate(found: Probe, period_ns: int) -> Finding:
    text = f"{1e9 / period_ns:g} Hz"
    if mend := rate_problem(found.version, period_ns):
        return Finding("rate", text, Verdict.PROBLEM, f"the robot {mend}")
    return Finding("rate", text, Verdict.OK)


def _arm(options: UrOptions) -> Finding:
    prediction = Prediction(options, Address(options.host))
    try:
        arm, _ = prediction.look()
    except LinkError as error:
        verdict = Verdict.PROBLEM if options.check_joints else Verdict.OK
        mend = "see above; motions are refused as long as the joints cannot be predicted"
        return Finding("arm", str(error), verdict, mend if options.check_joints else "")
    how = "its own calibration" if arm.is_calibrated else "the published lengths"
    return Finding("arm", f"{arm.name}, by {how}", Verdict.OK)


def _remote_control(found: Probe, *, is_needed: bool) -> Finding:
    if not versions.has("a dashboard server", found.version):
        return Finding("remote control", "not known", Verdict.IMPROVE, NO_DASHBOARD)
    if not versions.has("is in remote control", found.version):
        text = f"{versions.name(found.version)} does not say"
        return Finding("remote control", text, Verdict.OK)
    if found.is_remote is None:
        mend = "look at the icon at the top right of the pendant: the robot does not say"
        return Finding("remote control", "not known", Verdict.IMPROVE, mend)
    if found.is_remote:
        return Finding("remote control", "on", Verdict.OK)
    if not is_needed:
        return Finding("remote control", "off, and not insisted on", Verdict.OK)
    return Finding(
        "remote control",
        "off",
        Verdict.PROBLEM,
        "switch to remote control with the icon at the top right of the pendant; it is enabled "
        "under Settings > System > Remote Control",
    )


def _readiness(found: Probe) -> Finding:
    reason = obstacle(found.robot_mode, found.safety_mode)
    if not reason:
        return Finding("readiness", "powered, brakes released, no stop", Verdict.OK)
    return Finding(
        "readiness", reason, Verdict.PROBLEM, "clear it on the pendant, or `orientd reset`"
    )


def _registers(found: Probe) -> Finding:
    if found.registers_are_free:
        return Finding("registers", "free", Verdict.OK)
    return Finding(
        "registers",
        "held by another client",
        Verdict.PROBLEM,
        "end the client that holds them: a daemon that runs with this robot, another program with "
        "ur_rtde, or a fieldbus enabled in the installation; or set the option `registers` to the "
        "other range",
    )


def _link(found: Probe) -> Finding:
    text = (
        f"round trip {1e3 * found.round_trip:.2f} ms, jitter {1e3 * found.jitter:.2f} ms in "
        f"{_PACKAGES} packages"
    )
    worst, tick = max(found.round_trip, found.jitter), tick_ns(found.version) * 1e-9
    if worst <= tick:
        return Finding("link", text, Verdict.OK)
    verdict = Verdict.IMPROVE if worst <= 5.0 * tick else Verdict.PROBLEM
    return Finding(
        "link",
        text,
        verdict,
        "a cable of its own from this machine to the robot, no wireless and no busy switch",
    )
