"""Whole sessions with `orientd serve mavlink`: MAVSDK, QGroundControl's messages, and nonsense."""

import math
import random
import time

import numpy as np
import pytest
from gimbal_bench import GimbalDaemon, await_hold, seldom
from harness import DaemonProcess, until

pytest.importorskip("pymavlink")

from mavlink_station import (
    ACCEPTED,
    CONFIGURE,
    DENIED,
    GIMBAL,
    IN_EARTH,
    IN_VEHICLE,
    LEVEL,
    NAN,
    PITCHYAW,
    UNSUPPORTED,
    gimbal,
    turn,
)
from pymavlink.dialects.v20 import common as mavlink

from orientd import connect
from orientd.protocol import control_pb2 as pb
from orientd_loopback import read_recording

pytestmark = pytest.mark.world

PITCH_YAW = mavlink.MAVLink_gimbal_manager_set_pitchyaw_message
ATTITUDE = mavlink.MAVLink_gimbal_manager_set_attitude_message
COMMAND = mavlink.MAVLink_command_long_message


@pytest.fixture
def gimbal_daemon(bus, tmp_path):
    pytest.importorskip("dynamixel_sdk")
    it = GimbalDaemon(tmp_path, bus.link).start()
    await_hold(it, "gimbal")
    yield it
    it.end()


class Sdk:
    """MAVSDK's gimbal plugin."""

    def __init__(self, port):
        mavsdk = pytest.importorskip("mavsdk")
        from mavsdk.plugins import gimbal as plugin

        kind = mavsdk.ComponentType.GROUND_STATION
        self.plugin = plugin
        self.sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        self.sdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        (system,) = until(self.sdk.get_systems, "MAVSDK to find a system")
        self.gimbal = plugin.Gimbal(system)
        (self.item,) = until(lambda: self.gimbal.gimbal_list().gimbals, "MAVSDK to find a gimbal")

    def aim(self, pitch, yaw, *, roll=0.0, is_locked=False, is_stream=False):
        """Send angles, degrees, and return whether MAVSDK calls it a success."""
        return self._set(self.gimbal.set_angles, roll, pitch, yaw, is_locked, is_stream)

    def turn(self, pitch_rate, yaw_rate, *, is_stream=False):
        """Send rates, degrees a second, and return whether MAVSDK calls it a success."""
        return self._set(self.gimbal.set_angular_rates, 0.0, pitch_rate, yaw_rate, False, is_stream)

    def take_control(self):
        self.gimbal.take_control(1, self.plugin.ControlMode.PRIMARY)

    def angles(self):
        """Return the measured pitch and yaw, degrees."""
        found = self.gimbal.get_attitude(1).euler_angle_forward
        return found.pitch_deg, found.yaw_deg

    def await_angles(self, pitch, yaw):
        def is_there():
            time.sleep(0.05)
            return self.angles() == pytest.approx((pitch, yaw), abs=0.3)

        until(is_there, f"pitch {pitch}, yaw {yaw}")

    def _set(self, call, roll, pitch, yaw, is_locked, is_stream):
        modes, sending = self.plugin.GimbalMode, self.plugin.SendMode
        mode = modes.YAW_LOCK if is_locked else modes.YAW_FOLLOW
        try:
            call(1, roll, pitch, yaw, mode, sending.STREAM if is_stream else sending.ONCE)
        except self.plugin.GimbalError:
            return False
        return True


@pytest.fixture
def sdk(gimbal_daemon):
    with gimbal(gimbal_daemon.socket, "--north", 20) as station:
        found = Sdk(station.gimbal[1])
        yield found
        found.sdk.destroy()


@pytest.mark.real
def test_mavsdk_commands_a_gimbal_a_hundred_times(sdk, gimbal_daemon):
    assert (sdk.item.vendor_name, sdk.item.model_name) == ("orientd", "dynamixel")
    assert sdk.item.custom_name == "gimbal"
    assert not sdk.aim(-10, 10)  # without control
    sdk.take_control()
    chance = random.Random(7)
    for _ in range(12):
        pitch, yaw = chance.uniform(-60, 60), chance.uniform(-150, 150)
        assert sdk.aim(pitch, yaw)
        assert not sdk.aim(-150, yaw)  # out of the range of an axis, while the gimbal moves
    sdk.await_angles(pitch, yaw)
    assert sdk.aim(-20, 50, is_locked=True)
    sdk.await_angles(-20, 30)
    with connect(gimbal_daemon.socket) as robot:
        resting = seldom(lambda: robot.state().devices["gimbal"].state == pb.STATE_HOLDING)
        until(resting, "the gimbal to rest")
    assert not sdk.aim(-150, 0)  # out of the range of an axis
    for step in range(60):
        assert sdk.aim(-20 + step, 30 - step, roll=0.2 * step, is_stream=True)
        time.sleep(0.03)
    assert sdk.aim(40, -30)
    sdk.await_angles(40, -30)

    def turns():
        assert sdk.turn(-15, 20, is_stream=True)
        time.sleep(0.05)
        pitch, yaw = sdk.angles()
        return pitch < 35 and yaw > -20

    until(turns, "the gimbal to turn at its rates")
    assert sdk.turn(0, 0)
    assert sdk.aim(0, 0)
    sdk.await_angles(0, 0)
    sdk.gimbal.release_control(1)
    assert not sdk.aim(10, 10)
    with connect(gimbal_daemon.socket) as robot:
        resting = seldom(lambda: robot.state().devices["gimbal"].state == pb.STATE_HOLDING)
        until(resting, "the gimbal to come to rest after its release")


def test_the_messages_of_qgroundcontrol_in_their_order(daemon):
    with gimbal(daemon.socket) as station:
        request = mavlink.MAV_CMD_REQUEST_MESSAGE
        number = mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION
        assert station.command(request, number) == ACCEPTED
        information = station.hear("GIMBAL_MANAGER_INFORMATION")
        assert information.gimbal_device_id == 1
        interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        number = mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
        assert station.command(interval, number, 0) == ACCEPTED
        number = mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS
        assert station.command(interval, number, 0) == ACCEPTED
        assert station.hear("GIMBAL_MANAGER_STATUS").primary_control_sysid == 0
        assert station.command(CONFIGURE, *station.source, -1, -1, NAN, NAN, 1) == ACCEPTED
        status = station.status()
        assert (status.primary_control_sysid, status.secondary_control_sysid) == (245, 0)
        assert station.point(-30, 20) == ACCEPTED
        station.await_attitude(0, -30, 20)
        # The buttons send rates and repeat them, and zeros in the end.
        for _ in range(3):
            assert station.command(PITCHYAW, NAN, NAN, 0, 10, LEVEL, 0, 1) == ACCEPTED
            station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: m.angular_velocity_z > 0.1)
        assert station.command(PITCHYAW, NAN, NAN, 0, 0, LEVEL, 0, 1) == ACCEPTED
        station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: abs(m.angular_velocity_z) < 1e-3)
        assert station.measured()[2] > 20
        assert station.command(PITCHYAW, 0, 0, NAN, NAN, mavlink.GIMBAL_DEVICE_FLAGS_NEUTRAL,
                               0, 1) == ACCEPTED  # fmt: skip
        station.await_attitude(0, 0, 0)
        assert station.command(CONFIGURE, -3, -3, -1, -1, NAN, NAN, 1) == ACCEPTED
        assert station.status().primary_control_sysid == 0


@pytest.mark.real
def test_retract_turns_every_axis_back_to_zero(gimbal_daemon):
    with gimbal(gimbal_daemon.socket) as station:
        station.take_control()
        assert station.point(-30, 170) == ACCEPTED
        station.await_attitude(0, -30, 170)
        assert station.point(-30, -160) == ACCEPTED
        station.await_attitude(0, -30, -160)
        retract = mavlink.GIMBAL_DEVICE_FLAGS_RETRACT
        assert station.point(-30, -160, flags=retract) == ACCEPTED
        station.await_attitude(0, 0, 0)
        with connect(gimbal_daemon.socket) as robot:
            cycles = robot.watch()
            zero = pytest.approx((0, 0, 0), abs=1e-6)
            until(lambda: next(cycles)[-1].sent_joints == zero, "every axis to be sent to zero")
        assert station.point(NAN, 10) == ACCEPTED
        station.await_attitude(0, 0, 10)


@pytest.mark.real
def test_information_has_ranges_and_capabilities(gimbal_daemon):
    with gimbal(gimbal_daemon.socket) as station:
        request = mavlink.MAV_CMD_REQUEST_MESSAGE
        for name in ("GIMBAL_MANAGER_INFORMATION", "GIMBAL_DEVICE_INFORMATION"):
            number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
            assert station.command(request, number, kind="int") == ACCEPTED
            found = station.hear(name)
            ranges = [found.roll_max, found.pitch_min, found.pitch_max, found.yaw_min]
            assert [math.degrees(one) for one in ranges] == pytest.approx([120, -100, 100, -270])
            assert found.cap_flags & mavlink.GIMBAL_DEVICE_CAP_FLAGS_HAS_ROLL_AXIS
        assert station.command(request, 0) == ACCEPTED
        assert station.command(request, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT) == DENIED
        assert station.command(request, NAN) == DENIED


def test_what_the_gimbal_does_not_have_is_answered(daemon):
    with gimbal(daemon.socket) as station:
        assert station.command(mavlink.MAV_CMD_DO_SET_ROI_LOCATION) == UNSUPPORTED
        station.send(mavlink.MAVLink_param_request_list_message(*GIMBAL))
        assert station.hear("PARAM_VALUE").param_count == 0
        station.send(mavlink.MAVLink_param_request_read_message(*GIMBAL, b"MNT", -1))
        assert station.hear("PARAM_VALUE").param_count == 0


def test_messages_come_at_the_requested_interval(daemon):
    with gimbal(daemon.socket) as station:
        interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        number = mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS

        def count():
            """Return how many attitudes come between two heartbeats, a second apart."""
            station.hear("HEARTBEAT")
            station.counts.clear()
            station.hear("HEARTBEAT")
            return station.counts["GIMBAL_DEVICE_ATTITUDE_STATUS"]

        until(lambda: 5 < count() <= 11, "the usual rate")
        assert station.command(interval, number, 20_000) == ACCEPTED
        until(lambda: count() > 15, "a higher rate")
        assert station.command(interval, number, -1) == ACCEPTED
        assert count() == 0
        assert station.command(interval, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 0) == DENIED
        assert station.command(interval, number, NAN) == DENIED


def valid(chance):
    """Return a message that would change something."""
    flags = LEVEL | IN_VEHICLE
    return chance.choice(
        [
            PITCH_YAW(*GIMBAL, flags, 1, 0.5, 0.5, NAN, NAN),
            ATTITUDE(*GIMBAL, flags, 1, turn(0, 30, 30), NAN, NAN, NAN),
            COMMAND(*GIMBAL, CONFIGURE, 0, 0, 0, 0, 0, 0, 0, 0),
            COMMAND(*GIMBAL, PITCHYAW, 0, 9, 9, 9, 9, flags, 0, 1),
        ]
    )


def invalid(chance):
    """Return a message that must not change anything."""
    flags = LEVEL | IN_VEHICLE
    other = (chance.choice([2, 77, 255]), chance.choice([1, 2, 155]))
    bad = chance.choice([math.inf, -math.inf])
    return chance.choice(
        [
            PITCH_YAW(*other, flags, 1, 0.5, 0.5, NAN, NAN),
            PITCH_YAW(*GIMBAL, flags, 5, 0.5, 0.5, NAN, NAN),
            PITCH_YAW(*GIMBAL, flags | IN_EARTH, 1, 0.5, 0.5, NAN, NAN),
            PITCH_YAW(*GIMBAL, flags, 1, bad, 0.1, NAN, NAN),
            PITCH_YAW(*GIMBAL, flags, 1, NAN, NAN, 0.1, bad),
            ATTITUDE(*GIMBAL, flags, 1, (bad, 0, 0, 1), NAN, NAN, NAN),
            ATTITUDE(*GIMBAL, flags, 1, (0, 0, 0, 0), 0.1, 0.1, 0.1),
            ATTITUDE(*GIMBAL, flags, 1, (1e30, 0, 0, 0), NAN, NAN, NAN),
            COMMAND(*other, CONFIGURE, 0, 0, 0, 0, 0, 0, 0, 0),
        ]
    )


def nonsense(chance, codec):
    """Return a datagram that must not change anything, from the component in control."""
    packed = bytearray(valid(chance).pack(codec))
    match chance.randrange(5):
        case 0:
            return chance.randbytes(chance.randrange(300))
        case 1:
            return bytes(packed[: chance.randrange(len(packed))])
        case 2:
            place = chance.randrange(1, len(packed))
            packed[place] ^= chance.randrange(1, 256)
            return bytes(packed)
        case 3:
            return b"\xfd" + chance.randbytes(chance.randrange(40)) + b"\0" + bytes(packed[1:])
    return invalid(chance).pack(codec)


def test_ten_thousand_malformed_packets_change_nothing(daemon):
    chance = random.Random(3)
    with gimbal(daemon.socket) as station:
        station.take_control()
        assert station.point(-20, 30) == ACCEPTED
        station.await_attitude(0, -20, 30)
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "the device to rest")
        before = daemon.device().cycle.q
        for number in range(10_000):
            station.socket.sendto(nonsense(chance, station.codec), station.gimbal)
            if number % 50 == 0:
                # Each answer shows that it has read everything before.
                assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 0) == ACCEPTED
        # What is well-formed and cannot be done is answered.
        assert station.command(PITCHYAW, math.inf, 0, NAN, NAN, LEVEL, 0, 1) == DENIED
        assert station.command(PITCHYAW, 0, 0, NAN, NAN, -1, 0, 1) == DENIED
        assert station.command(PITCHYAW, 0, 0, NAN, NAN, NAN, 0, 1) == DENIED
        assert station.command(CONFIGURE, 1.5, 1, 0, 0, 0, 0, 1) == DENIED
        assert station.command(CONFIGURE, NAN, 1, 0, 0, 0, 0, 1) == DENIED
        status = station.status()
        assert (status.primary_control_sysid, status.primary_control_compid) == station.source
        assert daemon.device().cycle.q == before
        assert station.point(NAN, 40) == ACCEPTED
        station.await_attitude(0, -20, 40)
        station.release()


def test_a_turn_ends_when_its_stream_or_its_client_ends(daemon):
    with gimbal(daemon.socket) as station:
        station.take_control()
        station.stream(NAN, NAN, 0, 15)
        station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: m.angular_velocity_z > 0.1)
        station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: abs(m.angular_velocity_z) < 1e-3)
        # A command turns until the client in control falls silent.
        assert station.point(NAN, NAN, 0, -15) == ACCEPTED
        station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: m.angular_velocity_z < -0.1)
        station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: abs(m.angular_velocity_z) < 1e-3)


@pytest.mark.parametrize("is_even", [True, False])
def test_a_stream_without_rates_does_not_pass_its_end(daemon, is_even):
    chance = random.Random(5)
    with gimbal(daemon.socket) as station:
        station.take_control()
        assert station.point(0, 0) == ACCEPTED
        station.await_attitude(0, 0, 0)
        begin = len(read_recording(daemon.recording))
        start = time.monotonic()
        while (yaw := 30.0 * (time.monotonic() - start)) < 60.0:
            station.stream(0, yaw)
            time.sleep(0.1 if is_even else chance.choice([0.02, 0.05, 0.1, 0.3]))
        station.stream(0, 60)
        station.await_attitude(0, 0, 60)
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "the device to rest")
        station.release()
    sent = read_recording(daemon.recording)[begin:]
    yaws = [-2.0 * math.degrees(math.atan2(one.q[3], one.q[0])) for one in sent]
    assert 59.9 < max(yaws) < 60.5
    assert min(np.array(yaws) - np.maximum.accumulate(yaws)) > -0.5


def test_jumps_of_the_setpoint_keep_the_limits_of_the_device(tmp_path):
    chance = random.Random(1)
    with DaemonProcess(tmp_path) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with gimbal(daemon.socket) as station:
            station.take_control()
            for _ in range(40):
                pitch, yaw = chance.uniform(-80, 80), chance.uniform(-180, 180)
                if chance.random() < 0.3:
                    assert station.point(pitch, yaw) == ACCEPTED
                elif chance.random() < 0.5:
                    station.stream(pitch, yaw, chance.uniform(0, 60), chance.uniform(0, 60))
                else:
                    station.stream(pitch, yaw)
                station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS")
            assert station.point(10, 20) == ACCEPTED
            station.await_attitude(0, 10, 20)
        daemon.assert_limits_kept()
