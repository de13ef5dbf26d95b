"""The options of the UR driver, checked.

A motion may set its own ``lookahead``, ``gain`` and ``servo_time`` in its ``device_options``.

``host``
    the robot's address; required.  The ports are fixed by the client library.
``lookahead``
    s, 0.03 to 0.2, default 0.1: smoothing time of the controller; the arm lags by about as much.
``gain``
    100 to 2000, default 300: how hard the controller pulls the arm to the setpoint.
``servo_time``
    s, 0.002 to 0.1, default one period: duration for which one setpoint commands the arm.
``model``
    model of the arm, as in ``ur10e``; by default as the controller reports, which must agree. Plans
    made without the robot need it.
``start_joints``
    six angles in rad: start of plans made without the robot; default elbow up, tool down.
``joint_acceleration_deg``
    degrees/s^2, 10 to 4584, default 2291.8 (40 rad/s^2): largest acceleration of any joint, in
    motions, stops and pauses.  ``ur_rtde`` accepts no more than the default, and controllers report
    it as the setting of their joints.  With a heavy tool an arm can do less.
``check_joints``
    whether to refuse motions that the arm's joints cannot follow; default true.
``tcp_offset``
    ``[x, y, z, rx, ry, rz]`` of the tool in the flange, m and rad; by default as set on the robot.
``payload_mass``, ``payload_cog``
    kg, and the centre of gravity ``[x, y, z]`` in m; by default as set on the robot.
``registers``
    RTDE registers of the control program: ``lower`` (0 to 23, default) or ``upper`` (24 to 47, from
        PolyScope 3.9 and 5.3 on), for example if a fieldbus holds the lower ones.
``watchdog_hz``
    1 to 100, default 10: the robot ends the program if it receives messages less often.
``feedback_timeout``
    s, 0.01 to 1, default 0.1: the driver reports missing feedback if the robot's clock does not
    advance for this long.  The device has another setting of this name.
``link_timeout``
    s, up to 2, default 0.5: the link counts as lost after this time.  The client library closes
    frozen connections after 2.5 s and may then crash or hang.
``stop_deceleration``
    m/s^2 and rad/s^2, default 10: deceleration when the robot leaves servo mode.
``unlock_timeout``
    s, default 8: how long a reset tries to unlock a protective stop; robots refuse it for 5 s.
``release_brakes``
    whether a reset powers the arm and releases its brakes; default true.
``arrival_tolerance_deg``
    degrees, 0.05 to 10, default 0.5: a motion is done once every joint, and the tool that the
    controller commands, is this close to its end.  If that takes longer than half a second, it is a
    fault (later with a lookahead above 0.1 s or a slow speed slider).  A millimetre of the tool
    counts as a milliradian.
``follow_tolerance_deg``
    degrees, 0.5 to 90, default 5: how far a joint may be from where the controller commands it to
    be at the same moment.  If it is farther for more than 0.1 s, it is a fault.  The command that
    the controller reports includes its smoothing, so lookahead and speed slider do not matter.
``keep_phase``
    whether to shift the deadlines slowly so that the controller's cycle uses every setpoint;
    default true.
``check_remote_control``
    whether to require remote control; default true.  CB3 robots and PolyScope X do not report it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import degrees, pi, radians
from typing import Any

from orientd.driver import check_names, choice, number, numbers, switch
from orientd_ur.arm import FASTEST_CHANGE, MODELS, ArmModel

Vector = tuple[float, ...]

# Name: lowest, highest, default.  The default of `servo_time` is the period.
_NUMBERS: dict[str, tuple[float, float, float]] = {
    "lookahead": (0.03, 0.2, 0.1),
    "gain": (100.0, 2000.0, 300.0),
    "servo_time": (0.002, 0.1, 0.002),
    "watchdog_hz": (1.0, 100.0, 10.0),
    "feedback_timeout": (0.01, 1.0, 0.1),
    "link_timeout": (0.05, 2.0, 0.5),
    "stop_deceleration": (0.1, 40.0, 10.0),
    "unlock_timeout": (0.1, 15.0, 8.0),
    "arrival_tolerance_deg": (0.05, 10.0, 0.5),
    "follow_tolerance_deg": (0.5, 90.0, 5.0),
    "joint_acceleration_deg": (10.0, 4584.0, degrees(FASTEST_CHANGE)),
}
REGISTERS = {"lower": 0, "upper": 24}
"""The first register of each range."""
TUNABLE = ("lookahead", "gain", "servo_time")
"""Options that a motion may set."""
_SWITCHES = ("release_brakes", "keep_phase", "check_remote_control", "check_joints")
_HEAVIEST = 50.0
_START_JOINTS = (0.0, -pi / 2, 4 * pi / 9, -4 * pi / 9, -pi / 2, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class UrOptions:
    """The options that the module describes, each with its checked value."""

    host: str
    model: ArmModel | None
    start_joints: Vector
    lookahead: float
    gain: float
    servo_time: float
    watchdog_hz: float
    feedback_timeout: float
    link_timeout: float
    stop_deceleration: float
    unlock_timeout: float
    arrival_tolerance_deg: float
    follow_tolerance_deg: float
    joint_acceleration_deg: float
    tcp_offset: Vector | None
    payload_mass: float | None
    payload_cog: Vector
    release_brakes: bool
    keep_phase: bool
    registers: str
    check_joints: bool
    check_remote_control: bool

    @property
    def joint_acceleration(self) -> float:
        """Largest acceleration of a joint, rad/s^2."""
        return radians(self.joint_acceleration_deg)


def check(given: Mapping[str, Any], *, period: float) -> UrOptions:
    """Return the options in *given*, with defaults for the rest.

    Args:
        given: the driver's table of the configuration.
        period: cycle period, s.

    Raises:
        ValueError: an option is unknown, missing or has a wrong value; the message names it.
    """
    check_names(given, {field.name for field in fields(UrOptions)})
    host = given.get("host")
    if not isinstance(host, str) or not host.strip() or host != host.strip():
        raise ValueError(f"host must be the robot's address, got {host!r}")
    settings: dict[str, Any] = {
        name: number(name, given.get(name, default), lowest, highest)
        for name, (lowest, highest, default) in _NUMBERS.items()
    }
    if "servo_time" not in given:
        # A setpoint for exactly a period would leave the arm without a command in some cycles.
        settings["servo_time"] = number("servo_time", max(period, 0.002), 0.002, 0.1)
    if settings["link_timeout"] < settings["feedback_timeout"]:
        raise ValueError(
            f"link_timeout must be at least feedback_timeout, {settings['feedback_timeout']}, "
            f"got {settings['link_timeout']}"
        )
    mass, offset = given.get("payload_mass"), given.get("tcp_offset")
    if mass is None and "payload_cog" in given:
        raise ValueError("payload_cog needs payload_mass")
    model = given.get("model")
    return UrOptions(
        host=host,
        model=None if model is None else MODELS[choice("model", model, MODELS)],
        start_joints=numbers("start_joints", given.get("start_joints", _START_JOINTS), 6),
        tcp_offset=None if offset is None else numbers("tcp_offset", offset, 6),
        registers=choice("registers", given.get("registers", "lower"), REGISTERS),
        payload_mass=None if mass is None else number("payload_mass", mass, 0.0, _HEAVIEST),
        payload_cog=numbers("payload_cog", given.get("payload_cog", (0.0, 0.0, 0.0)), 3),
        **{name: switch(name, given.get(name, True)) for name in _SWITCHES},
        **settings,
    )


def tuned(chosen: UrOptions, given: Mapping[str, Any]) -> UrOptions:
    """Return *chosen* with the options of one motion, a subset of :data:`TUNABLE`.

    Raises:
        ValueError: an option in *given* is not among these, or has a wrong value; the message names
            it.
    """
    settings: dict[str, Any] = {}
    for name, value in given.items():
        if name not in TUNABLE:
            allowed = ", ".join(TUNABLE)
            raise ValueError(f"{name!r} is no option of one motion, those are: {allowed}")
        lowest, highest, _ = _NUMBERS[name]
        settings[name] = number(name, value, lowest, highest)
    return replace(chosen, **settings)
