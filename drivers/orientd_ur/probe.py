"""Inspect a controller before the client library connects to it.

If a controller accepts a connection and sends nothing, the library waits for ever with the
interpreter's lock.  For versions that it does not know, it ends the process.  This probe uses plain
sockets with timeouts and reports problems; it changes nothing on the robot.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

from orientd.driver import Joints
from orientd.errors import LinkError
from orientd_ur import controller
from orientd_ur.pose import Pose, pose_of
from orientd_ur.wire import SCRIPT_PORT, Connection, Dashboard, RtdeClient

_TRIPS = 5
_STATE = ("timestamp", "robot_mode", "safety_mode", "runtime_state")
_TOOL = "tcp_offset"
_PLACE = ("target_q", "target_TCP_pose", _TOOL)


@dataclass(frozen=True, slots=True)
class Probe:
    """Results of the probe.

    Attributes:
        version: of its software.
        is_remote: whether it is in remote control; ``None`` if the software does not report it.
        robot_mode, safety_mode, runtime_state: the controller's numbers.
        registers_are_free: whether the registers of the control script are available.
        round_trip: s from a request to its answer, the median of a few.
        jitter: s, the largest deviation of packages from their even spacing.
    """

    version: tuple[int, ...]
    is_remote: bool | None
    robot_mode: int
    safety_mode: int
    runtime_state: int
    registers_are_free: bool
    round_trip: float
    jitter: float


def look(host: str, *, timeout: float = 2.0, packages: int = 5, first_register: int = 0) -> Probe:
    """Inspect the controller at *host*.

    Args:
        host: its address.
        timeout: s for each answer.
        packages: number of data packages to wait for, 2 or more.
        first_register: first register of the control program.

    Raises:
        LinkError: a server does not answer; the message names it.
    """
    is_remote, missing = None, None
    try:
        with Dashboard(host, timeout=timeout) as dashboard:
            is_remote = dashboard.is_remote
    except LinkError as error:
        missing = error  # PolyScope X has none
    try:
        client = RtdeClient(host, timeout)
    except LinkError as error:
        raise missing or error from error
    with client:
        trips = []
        for _ in range(_TRIPS):
            begun = time.monotonic()
            version = client.controller_version()
            trips.append(time.monotonic() - begun)
        if missing is not None and controller.has("a dashboard server", version):
            raise missing
        # Only requested, and released when the connection ends.
        kinds = ("int", "double")
        is_free = client.claim(*(f"input_{kind}_register_{first_register}" for kind in kinds))
        client.subscribe(500.0 if version[0] > 3 else 125.0, _STATE)
        arrivals = []
        for _ in range(max(2, packages)):
            state = client.sample()
            arrivals.append(time.monotonic() - state["timestamp"][0])
    Connection(host, SCRIPT_PORT, "script server", timeout).sock.close()
    return Probe(
        version=version,
        is_remote=is_remote if controller.has("is in remote control", version) else None,
        robot_mode=int(state["robot_mode"][0]),
        safety_mode=int(state["safety_mode"][0]),
        runtime_state=int(state["runtime_state"][0]),
        registers_are_free=is_free,
        round_trip=sorted(trips)[_TRIPS // 2],
        jitter=max(arrivals) - min(arrivals),
    )


class Place(NamedTuple):
    """The commanded pose of an arm.

    Attributes:
        joints: rad.
        pose: of the tool in the base.
        tool: pose of the tool in the flange, as set in the controller; ``None`` if it does not
            report it.
    """

    joints: Joints
    pose: Pose
    tool: Pose | None


def whereabouts(address: str, *, timeout: float = 0.5) -> Place:
    """Return the commanded pose of the arm from the controller at *address*.

    Args:
        address: of the controller.
        timeout: s in total.

    Raises:
        LinkError: it does not answer, or lacks a variable.
    """
    with RtdeClient(address, timeout, total=timeout) as client:
        client.subscribe(125.0, _PLACE, optional=_TOOL)
        said = client.sample()
    tool = said.get(_TOOL)
    return Place(
        said["target_q"], pose_of(said["target_TCP_pose"]), pose_of(tool) if tool else None
    )
