"""A look at a controller before the client library is let near it.

The library waits for ever, the interpreter's lock in its hand, for a controller that accepts and
says nothing, and ends the process on versions it does not know.  This looks with plain sockets and
time limits and says what is wrong; it changes nothing on the robot.
"""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass
from typing import NamedTuple

from orientd.errors import LinkError
from orientd_ur import rtde, versions
from orientd_ur.dashboard import Dashboard
from orientd_ur.rtde_client import RtdeClient
from orientd_ur.sockets import SCRIPT_PORT


@dataclass(frozen=True, slots=True)
class Probe:
    """What a look at a controller found.

    Attributes:
        version: of its software.
        is_remote: whether it is in remote control; ``None`` where the software does not say.
        robot_mode, safety_mode, runtime_state: the controller's numbers, see `states`.
        registers_are_free: whether the registers of the control script can be had.
        round_trip: s from a request to its answer, the median of a few.
        jitter: s, the largest departure of packages from their even spacing.
    """

    version: tuple[int, ...]
    is_remote: bool | None
    robot_mode: int
    safety_mode: int
    runtime_state: int
    registers_are_free: bool
    round_trip: float
    jitter: float

    @property
    def version_problem(self) -> str:
        """Why the client library cannot drive this version; nothing where it can."""
        return versions.problem(self.version)


def look(host: str, *, timeout: float = 2.0, packages: int = 5, first_register: int = 0) -> Probe:
    """Look at the controller at *host*.

    Args:
        host: its address.
        timeout: s that each answer may take.
        packages: how many data packages to wait for, 2 or more.
        first_register: of those that the control program uses.

    Raises:
        LinkError: something does not answer; the message says what.
    """
    missing: LinkError | None = None
    is_remote: bool | None = None
    try:
        with Dashboard(host, timeout=timeout) as dashboard:
            is_remote = dashboard.is_remote
    except LinkError as error:
        missing = error  # PolyScope X has none
    try:
        client = RtdeClient(host, timeout)
    except LinkError:
        if missing is not None:
            raise missing from None
        raise
    with client:
        trips = []
        for _ in range(5):
            begun = time.monotonic()
            version = rtde.controller_version(client.ask(rtde.package(rtde.CONTROLLER_VERSION)))
            trips.append(time.monotonic() - begun)
        if missing is not None and versions.has("a dashboard server", version):
            raise missing
        # Only asked for, and given back with the connection's end.
        kinds = ("int", "double")
        names = [f"input_{kind}_register_{first_register}" for kind in kinds]
        inputs = client.ask(rtde.inputs_request(*names))
        frequency = 500.0 if version[0] > 3 else 125.0
        if lacks := rtde.missing(client.ask(rtde.outputs_request(frequency)), rtde.PROBED):
            raise LinkError(f"{host} does not know the RTDE variable {', '.join(lacks)}")
        client.ask(rtde.package(rtde.START))
        arrivals, latest = [], (0.0, 0, 0, 0)
        for _ in range(max(2, packages)):
            latest = rtde.sample(client.await_kind(rtde.DATA))
            arrivals.append(time.monotonic() - latest[0])
    try:
        socket.create_connection((host, SCRIPT_PORT), timeout).close()
    except OSError as error:
        raise LinkError(f"no script port at {host}:{SCRIPT_PORT}: {error}") from error
    return Probe(
        version=version,
        is_remote=is_remote if versions.has("is in remote control", version) else None,
        robot_mode=latest[1],
        safety_mode=latest[2],
        runtime_state=latest[3],
        registers_are_free=b"IN_USE" not in inputs,
        round_trip=sorted(trips)[len(trips) // 2],
        jitter=max(arrivals) - min(arrivals),
    )


class Place(NamedTuple):
    """Where a controller commands its arm to be.

    Attributes:
        joints: rad.
        pose: of the tool, m and rad.
        tcp_offset: pose of the tool in the flange, m and rad.
        is_offset_told: whether the controller said that offset.
    """

    joints: tuple[float, ...]
    pose: tuple[float, ...]
    tcp_offset: tuple[float, ...]
    is_offset_told: bool = True


def whereabouts(
    address: str, *, timeout: float = 0.5, tcp_offset: tuple[float, ...] | None = None
) -> Place:
    """Return where the controller at *address* commands its arm to be.

    Args:
        address: of the controller.
        timeout: s for the whole of it.
        tcp_offset: of the tool, m and rad, where the controller does not say it.

    Raises:
        LinkError: it does not answer, or does not say what is needed.
    """
    names: tuple[str, ...] = rtde.PLACE
    with RtdeClient(address, timeout, total=timeout) as client:
        lacks = rtde.missing(client.ask(rtde.outputs_request(125.0, names)), names)
        if lacks == [rtde.TCP_OFFSET]:
            if tcp_offset is None:
                raise LinkError(
                    f"{address} does not say its TCP offset, as newer software does "
                    f"({versions.first_versions(rtde.TCP_OFFSET)}); set the option `tcp_offset`"
                )
            names = names[:2]
            lacks = rtde.missing(client.ask(rtde.outputs_request(125.0, names)), names)
        if lacks:
            raise LinkError(f"{address} does not know the RTDE variable {', '.join(lacks)}")
        client.ask(rtde.package(rtde.START))
        joints, pose, *offset = rtde.vectors(client.await_kind(rtde.DATA), len(names))
        return Place(joints, pose, *(offset or (tcp_offset or (), False)))
