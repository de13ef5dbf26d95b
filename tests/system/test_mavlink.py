"""`orientd serve mavlink` over UDP, against a daemon in a process of its own."""

import math
import socket
import time

import pytest
from command_line import assert_refused, orientd

pytest.importorskip("pymavlink")

from mavlink_station import (
    ACCEPTED,
    AUTOPILOT,
    CONFIGURE,
    DENIED,
    GIMBAL,
    IN_EARTH,
    IN_VEHICLE,
    LEVEL,
    NAN,
    REJECTED,
    YAW_LOCK,
    Station,
    gimbal,
    turn,
)
from pymavlink.dialects.v20 import common as mavlink

from orientd import connect

pytestmark = pytest.mark.world


@pytest.fixture(scope="module")
def served(daemon):
    """Return a station that hears from a gimbal without a heading."""
    with gimbal(daemon.socket) as station:
        yield station
        station.errors = None


@pytest.fixture
def station(served):
    """Return the station, in control of the gimbal, which looks forward."""
    served.take_control()
    served.await_attitude(*forward(served))
    yield served
    served.release()


def forward(station):
    assert station.point(0, 0) == ACCEPTED
    return 0, 0, 0


# Who is in control


def test_only_the_component_in_control_may_command(served):
    assert served.point(10, 20) == DENIED
    served.take_control()
    status = served.status()
    assert (status.primary_control_sysid, status.primary_control_compid) == served.source
    other = Station(served.gimbal, (7, 8))
    assert other.point(30, 40) == DENIED
    other.stream(30, 40)
    other.attitude(turn(0, 30, 40))
    assert served.point(5, 6) == ACCEPTED
    served.await_attitude(0, 5, 6)
    served.release()
    assert served.status().primary_control_sysid == 0
    assert served.point(10, 20) == DENIED
    other.close()


def test_another_client_of_the_device_keeps_it(served, daemon):
    with connect(daemon.socket) as robot:
        robot.acquire_lease()
        assert served.command(CONFIGURE, *served.source, 0, 0, 0, 0, 1) == REJECTED
    served.take_control()
    served.release()


def test_the_autopilot_commands_its_device_while_nobody_else_is_in_control(served):
    autopilot = Station(served.gimbal, AUTOPILOT)
    message = mavlink.MAVLink_gimbal_device_set_attitude_message
    autopilot.send(message(*GIMBAL, LEVEL | IN_VEHICLE, turn(0, -20, 15), NAN, NAN, NAN))
    served.await_attitude(0, -20, 15)
    assert served.status().primary_control_compid == AUTOPILOT[1]
    served.take_control()
    autopilot.send(message(*GIMBAL, LEVEL | IN_VEHICLE, turn(0, 30, 30), NAN, NAN, NAN))
    assert served.point(-10, 5) == ACCEPTED
    served.await_attitude(0, -10, 5)
    served.release()
    autopilot.close()


def test_a_gimbal_comes_to_rest_when_another_component_takes_control(served):
    served.take_control()
    served.await_attitude(*forward(served))
    assert served.point(NAN, NAN, 0, 5) == ACCEPTED
    served.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: m.angular_velocity_z > 0.05)
    other = Station(served.gimbal, (7, 8))
    other.take_control()
    began = time.monotonic()
    served.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: abs(m.angular_velocity_z) < 1e-3)
    # A component in control that is silent lets it turn for longer.
    assert time.monotonic() - began < 2.0
    other.release()
    other.close()


# Unset values


def test_an_unset_angle_keeps_its_last_setpoint(station):
    assert station.point(-20, 30) == ACCEPTED
    station.await_attitude(0, -20, 30)
    assert station.point(-40, NAN) == ACCEPTED
    station.await_attitude(0, -40, 30)
    assert station.point(NAN, 10) == ACCEPTED
    station.await_attitude(0, -40, 10)
    station.stream(NAN, 50)
    station.await_attitude(0, -40, 50)
    station.attitude((NAN, NAN, NAN, NAN))
    station.attitude((1.0, 0.0, NAN, 0.0))
    station.await_attitude(0, -40, 50)


def test_an_unset_rate_lets_its_axis_stand_and_the_others_turn(station):
    station.attitude((NAN,) * 4, (0.0, math.radians(-20), NAN))
    station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: m.angular_velocity_y < -0.3)
    station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: abs(m.angular_velocity_y) < 1e-3)
    roll, pitch, yaw = station.measured()
    assert -40 < pitch < -10
    assert (roll, yaw) == pytest.approx((0, 0), abs=0.1)


def test_straight_down_has_finite_angles_and_keeps_the_yaw(station):
    assert station.point(-90, 40) == ACCEPTED
    station.await_attitude(0, -90, 40)
    message = station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS")
    assert all(map(math.isfinite, message.q))
    station.attitude(turn(0, -90, 40))
    assert station.point(-45, NAN) == ACCEPTED
    station.await_attitude(0, -45, 40)


# Frames


def test_a_yaw_from_north_is_denied_while_the_heading_is_unknown(station):
    assert math.isnan(station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS").delta_yaw)
    assert station.point(0, 45, flags=LEVEL | IN_EARTH) == DENIED
    assert station.point(0, 45, flags=LEVEL | YAW_LOCK) == DENIED
    station.stream(0, 45, flags=LEVEL | YAW_LOCK | IN_EARTH)
    assert station.point(1, 2) == ACCEPTED
    station.await_attitude(0, 1, 2)


def test_a_yaw_in_two_frames_is_denied(station):
    assert station.point(0, 45, flags=LEVEL | IN_EARTH | IN_VEHICLE) == DENIED


def test_north_is_as_given(daemon):
    with gimbal(daemon.socket, "--north", 90) as station:
        station.take_control()
        assert station.point(0, 45, flags=LEVEL | IN_EARTH | YAW_LOCK) == ACCEPTED
        station.await_attitude(0, 0, -45)
        flags = station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS").flags
        assert flags & mavlink.GIMBAL_DEVICE_FLAGS_ACCEPTS_YAW_IN_EARTH_FRAME
        assert flags & YAW_LOCK
        assert station.received["GIMBAL_DEVICE_ATTITUDE_STATUS"].delta_yaw == pytest.approx(
            math.pi / 2
        )
        # Without a flag of the frame, the lock decides.
        assert station.point(0, 80, flags=LEVEL | YAW_LOCK) == ACCEPTED
        station.await_attitude(0, 0, -10)
        assert station.point(0, 80, flags=LEVEL) == ACCEPTED
        station.await_attitude(0, 0, 80)
        # A yaw from the vehicle may be locked too.
        assert station.point(0, 20, flags=LEVEL | YAW_LOCK | IN_VEHICLE) == ACCEPTED
        station.await_attitude(0, 0, 20)
        station.stream(10, 100, flags=LEVEL | IN_EARTH)
        station.await_attitude(0, 10, 10)


def test_locked_axes_keep_their_angles_while_the_vehicle_turns(served):
    autopilot = Station(served.gimbal, AUTOPILOT)
    autopilot.vehicle(0, 0, 90)
    served.take_control()
    served.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: not math.isnan(m.delta_yaw))
    assert served.point(-10, 45, flags=LEVEL | IN_EARTH | YAW_LOCK) == ACCEPTED
    served.await_attitude(0, -10, -45)
    autopilot.vehicle(0, 0, 60)
    served.await_attitude(0, -10, -15)
    autopilot.vehicle(20, 10, 60)
    # The attitude counts from the horizon, and the device follows in its own base.
    served.await_attitude(0, -10, -15)
    assert served.point(-10, -15, flags=IN_VEHICLE) == ACCEPTED
    autopilot.vehicle(0, 0, 0)
    served.await_attitude(0, -10, -15)
    served.release()
    autopilot.close()


def test_the_heading_of_a_vehicle_that_fell_silent_is_unknown_again(served):
    autopilot = Station(served.gimbal, AUTOPILOT)
    served.take_control()
    autopilot.vehicle(0, 0, 90)
    said = time.monotonic()
    served.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: not math.isnan(m.delta_yaw))
    assert served.point(0, 45, flags=LEVEL | IN_EARTH | YAW_LOCK) == ACCEPTED
    served.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: math.isnan(m.delta_yaw))
    assert time.monotonic() - said > 1.9
    assert served.point(0, 45, flags=LEVEL | IN_EARTH | YAW_LOCK) == DENIED
    served.release()
    autopilot.close()


# Addresses


def test_ids_are_as_given_and_others_are_ignored(daemon):
    with gimbal(daemon.socket, "--system", 9, "--component", 171, source=(9, 171)) as station:
        assert station.command(CONFIGURE, *station.source, 0, 0, 0, 0, 1, target=(9, 171)) == 0
        begun = station.measured()
        for target in ((1, 171), (9, 154), GIMBAL):
            station.attitude(turn(0, 30, 40), target=target)
            values = (*target, CONFIGURE, 0, 0, 0, 0, 0, 0, 0, 0)
            station.send(mavlink.MAVLink_command_long_message(*values))
        # For a gimbal device that another component has.
        pitch_yaw = (mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, 30, 40, NAN, NAN, IN_VEHICLE, 0)
        assert station.command(*pitch_yaw, 3, target=(9, 171)) == DENIED
        status = station.status()
        assert (status.primary_control_sysid, status.primary_control_compid) == station.source
        assert station.measured() == pytest.approx(begun, abs=0.01)


def test_a_problem_at_the_start_is_one_clear_line(daemon):
    def refused(*arguments, status=1):
        done = orientd("serve", "mavlink", *arguments, "--socket", daemon.socket)
        return lambda *parts: assert_refused(done, *parts, status=status)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        refused("--port", port)(f"port {port} is in use", "--port")
    refused("--port", 0, "--host", "192.0.2.1")("cannot serve at 192.0.2.1", "--host")
    refused("--client", "nowhere", status=2)("expected HOST:PORT, got 'nowhere'")
    refused("--port", 0, "-d", "leg")("got 'leg'")
