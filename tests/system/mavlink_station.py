"""A ground station that speaks MAVLink with `orientd serve mavlink`, message by message."""

import contextlib
import math
import signal
import socket
import time
from collections import Counter

from command_line import begin
from harness import until
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

NAN = math.nan
LEVEL = mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
IN_VEHICLE = mavlink.GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME
IN_EARTH = mavlink.GIMBAL_MANAGER_FLAGS_YAW_IN_EARTH_FRAME
YAW_LOCK = mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
PITCHYAW = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW
CONFIGURE = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE

GIMBAL = (1, 154)
STATION = (245, 190)
AUTOPILOT = (1, 1)


class Station:
    """A component with a socket of its own.

    Attributes:
        source: its system and component.
        received: the newest message of each type.
        counts: number of messages of each type.
    """

    def __init__(self, gimbal=None, source=STATION, sender=GIMBAL):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.socket.settimeout(0.5)
        self.gimbal, self.source, self.sender = gimbal, source, sender
        self.codec = mavlink.MAVLink(None, *source)
        self.parser = mavlink.MAVLink(None)
        self.received, self.counts = {}, Counter()

    def send(self, message):
        self.socket.sendto(message.pack(self.codec), self.gimbal)
        self.codec.seq = (self.codec.seq + 1) % 256

    def hear(self, name, accept=lambda message: True, seconds=20.0):
        """Return the next message of a type."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with contextlib.suppress(TimeoutError):
                datagram, self.gimbal = self.socket.recvfrom(65536)
                for message in self.parser.parse_buffer(datagram) or []:
                    assert (message.get_srcSystem(), message.get_srcComponent()) == self.sender
                    self.received[message.get_type()] = message
                    self.counts[message.get_type()] += 1
                    if message.get_type() == name and accept(message):
                        return message
        raise AssertionError(f"no {name}, but {self.received}")

    def command(self, number, *parameters, target=GIMBAL, kind="long"):
        """Send a command, and return its result."""
        p = [*parameters, *[0.0] * (7 - len(parameters))]
        if kind == "int":
            p[4:6] = int(p[4]), int(p[5])
            self.send(mavlink.MAVLink_command_int_message(*target, 0, number, 0, 0, *p))
        else:
            self.send(mavlink.MAVLink_command_long_message(*target, number, 0, *p))
        ack = self.hear("COMMAND_ACK", lambda message: message.command == number)
        assert (ack.target_system, ack.target_component) == self.source
        return ack.result

    def take_control(self):
        assert self.command(CONFIGURE, *self.source, 0, 0, 0, 0, 1) == ACCEPTED

    def release(self):
        assert self.command(CONFIGURE, -3, -3, -3, -3, 0, 0, 1) == ACCEPTED

    def point(self, pitch, yaw, *rates, flags=LEVEL | IN_VEHICLE, kind="long"):
        """Send pitch and yaw, degrees, as a command, and return its result."""
        pitch_rate, yaw_rate = rates or (NAN, NAN)
        return self.command(PITCHYAW, pitch, yaw, pitch_rate, yaw_rate, flags, 0, 1, kind=kind)

    def stream(self, pitch, yaw, pitch_rate=NAN, yaw_rate=NAN, flags=LEVEL | IN_VEHICLE):
        """Send pitch and yaw, degrees, as a message."""
        angles = map(math.radians, (pitch, yaw, pitch_rate, yaw_rate))
        self.send(mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(*GIMBAL, flags, 1, *angles))

    def attitude(self, q, omega=(NAN, NAN, NAN), flags=LEVEL | IN_VEHICLE, target=GIMBAL):
        """Send a quaternion (w, x, y, z) to the manager."""
        self.send(mavlink.MAVLink_gimbal_manager_set_attitude_message(*target, flags, 1, q, *omega))

    def vehicle(self, roll, pitch, yaw):
        """Send the attitude of the vehicle, degrees."""
        self.send(
            mavlink.MAVLink_autopilot_state_for_gimbal_device_message(
                *GIMBAL, 0, turn(roll, pitch, yaw), 0, 0, 0, 0, 0, NAN, 0, 0
            )
        )

    def status(self):
        """Return the newest status of the manager."""
        self.hear("GIMBAL_MANAGER_STATUS")
        return self.hear("GIMBAL_MANAGER_STATUS")

    def measured(self):
        """Return the next measured roll, pitch and yaw, degrees."""
        w, x, y, z = self.hear("GIMBAL_DEVICE_ATTITUDE_STATUS").q
        yaw, pitch, roll = Rotation.from_quat([x, y, z, w]).as_euler("ZYX", degrees=True)
        return roll, pitch, yaw

    def await_attitude(self, roll, pitch, yaw, tolerance=0.2):
        """Wait until the gimbal has an attitude, degrees."""
        w, x, y, z = turn(roll, pitch, yaw)
        wanted = Rotation.from_quat([x, y, z, w])

        def is_there():
            w, x, y, z = self.hear("GIMBAL_DEVICE_ATTITUDE_STATUS").q
            error = (wanted.inv() * Rotation.from_quat([x, y, z, w])).magnitude()
            return math.degrees(error) < tolerance

        until(is_there, f"roll {roll}, pitch {pitch}, yaw {yaw}")

    def close(self):
        self.socket.close()


def turn(roll, pitch, yaw):
    """Return the quaternion (w, x, y, z) of angles in degrees."""
    x, y, z, w = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_quat()
    return w, x, y, z


@contextlib.contextmanager
def gimbal(socket_path, *arguments, source=GIMBAL):
    """Serve a daemon's device; yield a station that hears from it."""
    station = Station(sender=source)
    server = begin(
        "serve", "mavlink", "--port", 0, "--client", f"127.0.0.1:{station.port}",
        "--socket", socket_path, *arguments,
    )  # fmt: skip
    line = server.stdout.readline()
    assert line.startswith("ready at "), (line, server.stderr.read())
    station.server = server
    station.hear("HEARTBEAT")
    try:
        yield station
    finally:
        station.close()
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=30.0)
        station.errors = errors or ""
        assert server.returncode == 0, station.errors
        assert "Traceback" not in station.errors, station.errors
