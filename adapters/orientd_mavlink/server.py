"""Serve a MAVLink gimbal, device and manager, over UDP.

Source: the gimbal protocol v2, https://mavlink.io/en/services/gimbal_v2.html.  Only components that
have taken control may command the gimbal.
"""

from __future__ import annotations

import contextlib
import json
import math
import select
import socket
import struct
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from orientd.errors import OrientdError
from orientd.own_socket import own_socket
from orientd_mavlink.gimbal import Gimbal
from orientd_mavlink.reports import GIMBAL_ID, Reports
from orientd_mavlink.setpoint import RETRACT, Wish, attitude, level, wish_of
from orientd_serving.served import Served

Source = tuple[int, int]
"""System and component of a sender."""

Peer = tuple[str, int]

ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
"""Results of a command; a rejected one may succeed later."""

NOBODY: Source = (0, 0)
FREE = (NOBODY, NOBODY)
"""Primary and secondary holder while no component is in control."""

PERIOD = 0.02
"""Time between two looks at the gimbal, s."""

STREAM_LIFE = 1.0
"""Longest time between two messages of a stream of rates, s; then the gimbal comes to rest."""

CLIENT_LIFE = 3.0
"""Longest silence of the component in control while the gimbal turns at a rate, s."""

BASE_LIFE = 2.0
"""Longest time between two attitudes of the vehicle, s; then its heading counts as unknown."""

MOST_PEERS = 16
"""Most addresses that the gimbal sends to; a new one replaces the one silent for longest."""


class Mavlink:
    """A gimbal for ground stations, autopilots and companion computers.

    Attributes:
        endpoint: where it serves.
    """

    def __init__(
        self,
        served: Served,
        *,
        host: str,
        port: int,
        to: Iterable[Peer] = (),
        system: int = 1,
        component: int = mavlink.MAV_COMP_ID_GIMBAL,
        north: float | None = None,
        warn: Callable[[str], None],
    ) -> None:
        """Open the socket.

        Args:
            served: the device.
            host: own address.
            port: own port; 0 for any.
            to: addresses that hear from the gimbal before they have sent anything.
            system: MAVLink id of the vehicle.
            component: MAVLink id of the gimbal.
            north: angle of north from the world's x axis, towards y, rad; ``None`` if unknown.
            warn: called with each problem, in one line.

        Raises:
            DaemonError: the port is not available, or no daemon answers.
        """
        configuration = json.loads(served.robot.observe().configuration().json)
        settings = configuration["devices"][served.name]
        self._gimbal = Gimbal(served, settings["options"], north, warn)
        self._reports = Reports(served, self._gimbal, settings["driver"])
        self._warn = warn
        self._own: Source = (system, component)
        self._autopilot: Source = (system, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._codec = mavlink.MAVLink(None, system, component)
        self._peers: dict[Peer, float] = dict.fromkeys(to, math.inf)
        self._holders: Sequence[Source] = FREE
        self._heard, self._base_until, self._planned = -math.inf, math.inf, ""
        self._ticked = time.monotonic()
        self._handlers: dict[str, Callable[[Any, Source, Peer], None]] = {
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "GIMBAL_MANAGER_SET_PITCHYAW": self._on_wish,
            "GIMBAL_MANAGER_SET_MANUAL_CONTROL": self._on_wish,
            "GIMBAL_MANAGER_SET_ATTITUDE": self._on_wish,
            "GIMBAL_DEVICE_SET_ATTITUDE": self._on_wish,
            "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE": self._on_vehicle,
            "PARAM_REQUEST_LIST": self._on_parameters,
            "PARAM_REQUEST_READ": self._on_parameters,
        }
        self._socket = own_socket(host, port, socket.SOCK_DGRAM)
        self.endpoint = "{}:{}".format(*self._socket.getsockname()[:2])

    def serve(self) -> None:
        """Serve until the process is interrupted.

        Raises:
            DaemonError: the daemon is lost.
        """
        while True:
            wait = max(0.0, self._ticked + PERIOD - time.monotonic())
            if select.select([self._socket], [], [], wait)[0]:
                self._receive()
            now = time.monotonic()
            if now < self._ticked + PERIOD:
                continue
            self._ticked = now
            if now - self._heard > CLIENT_LIFE:
                self._gimbal.rest()
            if now > self._base_until:
                self._base_until, self._gimbal.knows_north = math.inf, False
            self._gimbal.tick()
            for message in self._reports.due():
                self._send(message, list(self._peers))

    def close(self) -> None:
        """Close the socket; return when no command runs any more."""
        self._gimbal.close()
        self._socket.close()

    def _send(self, message: Any, peers: Iterable[Peer]) -> None:  # noqa: ANN401 - pymavlink has no types
        packed = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        for peer in peers:
            with contextlib.suppress(OSError):  # the network cannot reach it now
                self._socket.sendto(packed, peer)

    def _receive(self) -> None:
        datagram, peer = self._socket.recvfrom(65536)
        # A parser of its own: an incomplete message must not spoil the next datagram.
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        try:
            messages = parser.parse_buffer(datagram) or []
        except (mavlink.MAVError, struct.error, ValueError, IndexError):
            return
        for message in messages:
            source = message.get_srcSystem(), message.get_srcComponent()
            handle = self._handlers.get(message.get_type())
            target = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
            if message.get_msgId() < 0 or source == self._own:
                continue
            self._hear(source, peer)
            if handle and all(a in {0, b} for a, b in zip(target, self._own, strict=True)):
                handle(message, source, peer)

    def _hear(self, source: Source, peer: Peer) -> None:
        now = time.monotonic()
        if source in self._holders:
            self._heard = now
        if len(self._peers) >= MOST_PEERS and peer not in self._peers:
            del self._peers[min(self._peers, key=self._peers.__getitem__)]
        self._peers[peer] = max(now, self._peers.get(peer, now))

    # Commands

    def _on_command(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        names = "x y z" if message.get_type() == "COMMAND_INT" else "param5 param6 param7"
        p = [float(getattr(message, f"param{k}")) for k in range(1, 5)]
        p += [float(getattr(message, name)) for name in names.split()]
        reply = None

        def answer(result: int) -> None:
            ack = mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *source)
            self._send(ack, [peer])

        match message.command:
            case mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                self._pitch_yaw(p, source, answer)
            case mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
                answer(self._configure(p, source))
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                answer(self._set_interval(p[0], p[1]))
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                reply = self._reports.message(p[0])
                if reply is None:
                    self._gimbal.deny(
                        f"a request for message {p[0]:g} is denied: {self._reports.offered}"
                    )
                answer(ACCEPTED if reply is not None else DENIED)
            case _ if message.target_component:
                answer(UNSUPPORTED)
        if reply is not None:
            self._send(reply, [peer])

    def _configure(self, p: Sequence[float], source: Source) -> int:
        """Set who is in control, and return the result."""
        primary = holder(p[0], p[1], self._holders[0], source)
        secondary = holder(p[2], p[3], self._holders[1], source)
        if not self._is_for_us(p[6]):
            return DENIED
        if primary is None or secondary is None:
            wrong = p[:2] if primary is None else p[2:4]
            self._gimbal.deny(
                f"control for the component {wrong[0]:g}/{wrong[1]:g} is denied: expected ids of 1 "
                "to 255, 0 for none, -1 for no change, -2 for the sender or -3 to release it"
            )
            return DENIED
        return self._control(primary, secondary)

    def _set_interval(self, number: float, microseconds: float) -> int:
        """Set the interval of a message, and return the result."""
        if self._reports.set_interval(number, microseconds):
            return ACCEPTED
        self._gimbal.deny(
            f"an interval of {microseconds:g} us for message {number:g} is denied: expected -1 for "
            f"never, 0 for the usual one, or a time; {self._reports.regular}"
        )
        return DENIED

    def _control(self, *holders: Source) -> int:
        try:
            if self._holders == FREE != holders:
                self._gimbal.begin()
        except OrientdError as error:
            self._warn(str(error))
            return REJECTED
        if self._holders != FREE == holders:
            self._gimbal.end()
        elif holders[0] != self._holders[0]:
            self._gimbal.rest()
        self._holders = self._reports.holders = holders
        self._heard = time.monotonic()
        return ACCEPTED

    def _pitch_yaw(self, p: Sequence[float], source: Source, answer: Callable[[int], None]) -> None:
        are_flags = 0.0 <= p[4] < 1 << 16 and p[4].is_integer()
        flags = int(p[4]) if are_flags else 0
        pitch, yaw, pitch_rate, yaw_rate = map(math.radians, p[:4])
        wish = level(flags, (pitch, yaw), (pitch_rate, yaw_rate))
        asked = repr((source, p))
        if asked == self._planned:
            return  # the client repeats a command that has no answer yet

        def done(is_done: bool) -> None:
            self._planned = ""
            answer(ACCEPTED if is_done else DENIED)

        if not self._may(source, p[6]):
            answer(DENIED)
        elif not are_flags:
            expected = "expected a whole number of 0 to 65535"
            self._gimbal.deny(f"flags of {p[4]:g} are denied: {expected}; add up the flags")
            answer(DENIED)
        elif not self._gimbal.can(wish):
            answer(DENIED)
        elif flags & RETRACT or (self._gimbal.is_idle and wish.is_still):
            self._planned = asked
            self._gimbal.plan(wish, done)
        else:
            self._gimbal.take(wish, life=math.inf)
            answer(ACCEPTED)

    # Streams

    def _on_wish(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        """Follow a stream.  The autopilot takes control of a free gimbal with its first one."""
        del peer
        gimbal = getattr(message, "gimbal_device_id", 0)
        is_for_device = message.get_type() == "GIMBAL_DEVICE_SET_ATTITUDE"
        if is_for_device and self._holders == FREE and source == self._autopilot:
            self._control(source, NOBODY)
        if not self._may(source, gimbal):
            return
        if message.get_type() == "GIMBAL_MANAGER_SET_MANUAL_CONTROL":
            wish: Wish | None = self._gimbal.ranges.of_sticks(message)
        else:
            wish = wish_of(message)
        if wish is None:
            self._gimbal.deny(
                f"a quaternion of norm {math.hypot(*message.q):.6g} is denied: expected norm 1; "
                "divide it by its norm"
            )
        elif self._gimbal.can(wish):
            self._gimbal.take(wish, life=STREAM_LIFE)

    def _on_vehicle(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        del peer
        angles = attitude(message.q)
        if source == self._autopilot and angles is not None and not math.isnan(angles[0]):
            self._base_until = time.monotonic() + BASE_LIFE
            self._gimbal.turn_base(angles)

    def _on_parameters(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        """Answer that there are no parameters."""
        del message, source
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        self._send(mavlink.MAVLink_param_value_message(b"", 0.0, kind, 0, 0xFFFF), [peer])

    def _may(self, source: Source, gimbal: float) -> bool:
        """Return whether a component may command a gimbal device id; otherwise warn of it."""
        if not self._is_for_us(gimbal):
            return False
        if source not in self._holders:
            self._gimbal.deny(
                f"a command of the component {source[0]}/{source[1]} is denied: it must first take "
                "control, by MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE"
            )
        return source in self._holders

    def _is_for_us(self, gimbal: float) -> bool:
        """Return whether a command is for this gimbal device, or for all; otherwise warn of it."""
        is_for_us = math.isnan(gimbal) or gimbal in {0, GIMBAL_ID}
        if not is_for_us:
            self._gimbal.deny(
                f"a command for the gimbal device {gimbal:g} is denied: this one has id {GIMBAL_ID}"
            )
        return is_for_us


def holder(system: float, component: float, present: Source, source: Source) -> Source | None:
    """Return the component in control after a command to configure it.

    Args:
        system: of the new holder; 0 for none, -1 for no change, -2 for the sender, -3 for none if
            the sender is in control.
        component: of the new holder.
        present: the component in control.
        source: the sender.

    Returns:
        System and component; ``None`` if the command is invalid.
    """
    named = {-1.0: present, -2.0: source, -3.0: NOBODY if present == source else present}
    if system in named:
        return named[system]
    if system == 0.0 or component == 0.0:
        return NOBODY
    is_valid = all(0.0 < one < 256.0 and one == int(one) for one in (system, component))
    return (int(system), int(component)) if is_valid else None
