"""The MAVLink component: its UDP socket, and what it does with the messages of others.

Source: the gimbal protocol v2, https://mavlink.io/en/services/gimbal_v2.html.  Only components that
have taken control may command the gimbal.  The autopilot of its own system takes control with its
first setpoint for the device, if no other component has it.
"""

from __future__ import annotations

import math
import select
import socket
import struct
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from orientd.adapters.mavlink.control import NOBODY, Source, holder
from orientd.adapters.mavlink.motion import GimbalMotion
from orientd.adapters.mavlink.reports import GIMBAL_ID, Reports
from orientd.adapters.mavlink.setpoint import RETRACT, UNSET, Base, Wish, angles_of
from orientd.adapters.served import Served
from orientd.driver import Vector3
from orientd.errors import OrientdError
from orientd.floats import normalize
from orientd.own_socket import own_socket
from orientd.tolerances import TYPED_NORM_TOLERANCE

Peer = tuple[str, int]
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
"""Results of a command; a rejected one may succeed later."""

PERIOD = 0.02
"""Time between two targets of a turning gimbal, s."""

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
        self._motion = GimbalMotion(served, Base(heading=north), warn)
        self._reports = Reports(served, self._motion)
        self._warn, self._fastest = warn, self._motion.limits.velocity
        self._own: Source = (system, component)
        self._codec = mavlink.MAVLink(None, system, component)
        self._peers: dict[Peer, float] = dict.fromkeys(to, math.inf)
        self._primary, self._secondary, self._heard = NOBODY, NOBODY, -math.inf
        self._base_until, self._planned = math.inf, ""
        self._ticked = time.monotonic()
        self._handlers: dict[str, Callable[[Any, Source, Peer], None]] = {
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "GIMBAL_MANAGER_SET_PITCHYAW": self._on_pitch_yaw,
            "GIMBAL_MANAGER_SET_MANUAL_CONTROL": self._on_pitch_yaw,
            "GIMBAL_MANAGER_SET_ATTITUDE": self._on_attitude,
            "GIMBAL_DEVICE_SET_ATTITUDE": self._on_attitude,
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
                self._motion.rest()
            if now > self._base_until:
                self._base_until = math.inf
                self._motion.lose_heading()
            self._motion.tick()
            for message in self._reports.due():
                self._send(message, list(self._peers))

    def close(self) -> None:
        """Close the socket; return when no command runs any more."""
        self._motion.close()
        self._socket.close()

    def _send(self, message: Any, peers: Iterable[Peer]) -> None:  # noqa: ANN401 - pymavlink has no types
        packed = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        for peer in peers:
            try:
                self._socket.sendto(packed, peer)
            except OSError:  # the network cannot reach it now
                continue

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
        if source in {self._primary, self._secondary}:
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
                answer(ACCEPTED if self._reports.set_interval(p[0], p[1]) else DENIED)
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                reply = self._reports.message(p[0])
                answer(ACCEPTED if reply is not None else DENIED)
            case _ if message.target_component:
                answer(UNSUPPORTED)
        if reply is not None:
            self._send(reply, [peer])

    def _configure(self, p: Sequence[float], source: Source) -> int:
        """Set who is in control, and return the result."""
        primary = holder(p[0], p[1], self._primary, source)
        secondary = holder(p[2], p[3], self._secondary, source)
        if primary is None or secondary is None or not _is_own(p[6]):
            return DENIED
        return self._control(primary, secondary)

    def _control(self, primary: Source, secondary: Source) -> int:
        had_control = self._primary != NOBODY or self._secondary != NOBODY
        has_control = primary != NOBODY or secondary != NOBODY
        try:
            if has_control and not had_control:
                self._motion.begin()
        except OrientdError as error:
            self._warn(str(error))
            return REJECTED
        if had_control and not has_control:
            self._motion.end()
        elif primary != self._primary:
            self._motion.rest()
        self._primary, self._secondary = primary, secondary
        self._reports.holders = (*primary, *secondary)
        self._heard = time.monotonic()
        return ACCEPTED

    def _pitch_yaw(self, p: Sequence[float], source: Source, answer: Callable[[int], None]) -> None:
        pitch, yaw, pitch_rate, yaw_rate = map(math.radians, p[:4])
        flags = int(p[4]) if 0.0 <= p[4] < 1 << 16 else 0
        wish = _level(flags, (pitch, yaw), (pitch_rate, yaw_rate))
        asked = repr((source, p))
        if asked == self._planned:
            return  # the client repeats a command that has no answer yet

        def done(is_done: bool) -> None:
            self._planned = ""
            answer(ACCEPTED if is_done else DENIED)

        if not (self._may(source, p[6]) and 0.0 <= p[4] < 1 << 16 and self._motion.can(wish)):
            answer(DENIED)
        elif flags & RETRACT or (self._motion.is_idle and wish.is_still):
            self._planned = asked
            self._motion.plan(wish, done)
        else:
            self._motion.take(wish, life=math.inf, is_stream=False)
            answer(ACCEPTED)

    # Streams

    def _on_pitch_yaw(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        del peer
        scales = (1.0, 1.0, 1.0, 1.0)
        if message.get_type() == "GIMBAL_MANAGER_SET_MANUAL_CONTROL":
            scales = (0.5 * math.pi, math.pi, self._fastest, self._fastest)
        given = (message.pitch, message.yaw, message.pitch_rate, message.yaw_rate)
        pitch, yaw, pitch_rate, yaw_rate = (a * b for a, b in zip(given, scales, strict=True))
        wish = _level(message.flags, (pitch, yaw), (pitch_rate, yaw_rate))
        if self._may(source, message.gimbal_device_id):
            self._stream(wish)

    def _on_attitude(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        del peer
        is_first = self._primary == self._secondary == NOBODY
        if message.get_type() == "GIMBAL_DEVICE_SET_ATTITUDE":
            if is_first and source == (self._own[0], mavlink.MAV_COMP_ID_AUTOPILOT1):
                self._control(source, NOBODY)
            gimbal = 0
        else:
            gimbal = message.gimbal_device_id
        angles = _angles(message.q)
        names = ("angular_velocity_x", "angular_velocity_y", "angular_velocity_z")
        x, y, z = (getattr(message, name) for name in names)
        if angles is not None and self._may(source, gimbal):
            self._stream(Wish(message.flags, angles, (x, y, z)))

    def _stream(self, wish: Wish) -> None:
        if self._motion.can(wish):
            self._motion.take(wish, life=STREAM_LIFE, is_stream=True)

    def _on_vehicle(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        del peer
        angles = _angles(message.q)
        is_ours = source == (self._own[0], mavlink.MAV_COMP_ID_AUTOPILOT1)
        if is_ours and angles is not None and not math.isnan(angles[0]):
            self._base_until = time.monotonic() + BASE_LIFE
            self._motion.turn_base(Base(*angles))

    def _on_parameters(self, message: Any, source: Source, peer: Peer) -> None:  # noqa: ANN401
        """Answer that there are no parameters."""
        del message, source
        none = mavlink.MAVLink_param_value_message(
            b"", 0.0, mavlink.MAV_PARAM_TYPE_REAL32, 0, 0xFFFF
        )
        self._send(none, [peer])

    def _may(self, source: Source, gimbal: float) -> bool:
        return source in {self._primary, self._secondary} and _is_own(gimbal)


def _is_own(gimbal: float) -> bool:
    """Return whether a gimbal device id is ours; 0 is for all."""
    return math.isnan(gimbal) or gimbal in {0, GIMBAL_ID}


def _level(flags: int, angles: tuple[float, float], rates: tuple[float, float]) -> Wish:
    """Return a wish for pitch and yaw.  With an angle it levels the roll, else the roll stays."""
    roll = math.nan if all(map(math.isnan, angles)) else 0.0
    return Wish(flags, (roll, *angles), (math.nan, *rates))


def _angles(q: Sequence[float]) -> Vector3 | None:
    """Return roll, pitch and yaw, NaN if a component is; ``None`` if *q* is not of unit norm."""
    size = math.hypot(*q)
    if math.isnan(size):
        return UNSET
    if abs(size - 1.0) > TYPED_NORM_TOLERANCE:
        return None
    w, x, y, z = q
    return angles_of(normalize((w, x, y, z)))
