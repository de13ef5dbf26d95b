"""Wrong requests of MAVLink programs: each is denied, at rest and in motion, with one line."""

import math
import time

import pytest
from harness import Lines

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
    gimbal,
)
from pymavlink.dialects.v20 import common as mavlink

pytestmark = pytest.mark.world


@pytest.fixture(scope="module")
def served(daemon):
    """Return a station in control of a gimbal without a heading, and what its server prints."""
    with gimbal(daemon.socket) as station:
        lines = Lines(station.server.stderr)
        station.take_control()
        yield station, lines
        station.server.stderr = None
    lines.close()


def command(*parameters, gimbal_id=1):
    p = [*parameters, *[NAN] * (4 - len(parameters))]
    return lambda station: station.command(PITCHYAW, *p, LEVEL | IN_VEHICLE, 0, gimbal_id)


# A command, and the line about it.
WRONG = {
    "decimal point lost in the pitch": (
        command(-4500, 0),
        "a pitch of -4500 degrees is denied: the gimbal announces -90 to 90 degrees",
    ),
    "decimal point lost in the yaw": (
        command(0, 24435),
        "a yaw of 24435 degrees is denied: the gimbal announces -180 to 180 degrees",
    ),
    "pitch past straight down": (
        command(-100, 0),
        "a pitch of -100 degrees is denied: the gimbal announces -90 to 90 degrees",
    ),
    "largest number": (
        command(1e30, 0),
        "a pitch of 1e+30 degrees is denied: the gimbal announces -90 to 90 degrees",
    ),
    "infinity": (
        command(math.inf, 0),
        "an infinite angle is denied: expected a number, or NaN for no change",
    ),
    "infinite rate": (
        command(NAN, NAN, 0, -math.inf),
        "an infinite rate is denied: expected a number, or NaN for no change",
    ),
    "rate of a motor": (
        command(NAN, NAN, 0, 3000),
        "a yaw rate of 3000 degrees/s is denied: expected at most 143.239, the velocity limit of "
        "the device",
    ),
    "two frames at once": (
        lambda station: station.point(0, 45, flags=LEVEL | IN_EARTH | IN_VEHICLE),
        "a yaw in the frames of the vehicle and of the earth at once is denied: set one of the "
        "flags",
    ),
    "yaw from north without a heading": (
        lambda station: station.point(0, 45, flags=LEVEL | IN_EARTH),
        "a yaw from north is denied: the heading is unknown; set --north, or let the autopilot "
        "send AUTOPILOT_STATE_FOR_GIMBAL_DEVICE",
    ),
    "flags that are none": (
        lambda station: station.point(0, 0, flags=-1),
        "flags of -1 are denied: expected a whole number of 0 to 65535; add up the flags",
    ),
    "flags that are no whole number": (
        lambda station: station.point(0, 0, flags=1.5),
        "flags of 1.5 are denied: expected a whole number of 0 to 65535; add up the flags",
    ),
    "control of another gimbal": (
        lambda station: station.command(CONFIGURE, -2, -2, -1, -1, 0, 0, 9),
        "a command for the gimbal device 9 is denied: this one has id 1",
    ),
    "control for no component": (
        lambda station: station.command(CONFIGURE, 300, 1, -1, -1, 0, 0, 1),
        "control for the component 300/1 is denied: expected ids of 1 to 255, 0 for none, -1 for "
        "no change, -2 for the sender or -3 to release it",
    ),
    "control for half a component": (
        lambda station: station.command(CONFIGURE, -1, -1, 2.5, 7, 0, 0, 1),
        "control for the component 2.5/7 is denied: expected ids of 1 to 255, 0 for none, -1 for "
        "no change, -2 for the sender or -3 to release it",
    ),
    "a message of another component": (
        lambda station: station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 999),
        "a request for message 999 is denied: this gimbal has the messages 0, 280, 281, 283, 285",
    ),
    "no message": (
        lambda station: station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, NAN),
        "a request for message nan is denied: this gimbal has the messages 0, 280, 281, 283, 285",
    ),
    "an interval of another message": (
        lambda station: station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 100000),
        "an interval of 100000 us for message 30 is denied: expected -1 for never, 0 for the usual "
        "one, or a time; this gimbal has the messages 0, 281, 285 at intervals",
    ),
    "no interval": (
        lambda station: station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 285, NAN),
        "an interval of nan us for message 285 is denied: expected -1 for never, 0 for the usual "
        "one, or a time; this gimbal has the messages 0, 281, 285 at intervals",
    ),
    "a negative interval": (
        lambda station: station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 285, -5),
        "an interval of -5 us for message 285 is denied: expected -1 for never, 0 for the usual "
        "one, or a time; this gimbal has the messages 0, 281, 285 at intervals",
    ),
    "infinite pitch rate": (
        command(NAN, NAN, -math.inf, NAN),
        "an infinite rate is denied: expected a number, or NaN for no change",
    ),
    "gimbal of another component": (
        command(0, 0, gimbal_id=3),
        "a command for the gimbal device 3 is denied: this one has id 1",
    ),
}
each = pytest.mark.parametrize(
    ("ask", "line"), WRONG.values(), ids=[name.replace(" ", "_") for name in WRONG]
)


@each
def test_a_wrong_command_is_denied_by_name_at_rest(served, ask, line):
    station, lines = served
    lines.forget()
    time.sleep(0.2)  # a few warnings a second
    assert ask(station) == DENIED
    assert lines.last() == f"orientd: {line}"


def test_a_wrong_command_is_denied_while_the_gimbal_moves(served):
    station, _ = served
    station.stream(0, 0)
    assert station.point(NAN, NAN, 0, 20) == ACCEPTED
    station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: m.angular_velocity_z > 0.3)
    for ask, _ in WRONG.values():
        assert ask(station) == DENIED
    turning = station.hear("GIMBAL_DEVICE_ATTITUDE_STATUS")
    assert turning.angular_velocity_z == pytest.approx(math.radians(20.0), abs=0.05)
    assert station.point(0, 0) == ACCEPTED
    station.await_attitude(0, 0, 0)


STREAMS = {
    "angles": (
        lambda station: station.stream(-120, 0),
        "a pitch of -120 degrees is denied: the gimbal announces -90 to 90 degrees",
    ),
    "rates": (
        lambda station: station.stream(NAN, NAN, 400, 0),
        "a pitch rate of 400 degrees/s is denied: expected at most 143.239, the velocity limit of "
        "the device",
    ),
    "norm": (
        lambda station: station.attitude((2.0, 0.0, 0.0, 0.0)),
        "a quaternion of norm 2 is denied: expected norm 1; divide it by its norm",
    ),
    "sticks": (
        lambda station: station.send(
            mavlink.MAVLink_gimbal_manager_set_manual_control_message(
                *GIMBAL, LEVEL | IN_VEHICLE, 1, NAN, NAN, 0.0, 7.0
            )
        ),
        "a yaw rate of 1002.68 degrees/s is denied: expected at most 143.239, the velocity limit "
        "of the device",
    ),
}


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_beyond_the_ranges_is_denied_and_said_once(served, name):
    station, lines = served
    ask, line = STREAMS[name]
    lines.forget()
    time.sleep(0.3)
    before = station.measured()
    for _ in range(30):
        ask(station)
        time.sleep(0.02)
    assert lines.last() == f"orientd: {line}"
    assert len(lines) == 0
    assert station.measured() == pytest.approx(before, abs=0.01)


def test_a_full_stick_asks_for_an_end_of_the_range(served):
    station, _ = served
    for _ in range(5):
        station.send(
            mavlink.MAVLink_gimbal_manager_set_manual_control_message(
                *GIMBAL, LEVEL | IN_VEHICLE, 1, -1.0, 0.0, NAN, NAN
            )
        )
        time.sleep(0.1)
    station.await_attitude(0, -90, 0)
    assert station.point(0, 0) == ACCEPTED
    station.await_attitude(0, 0, 0)


def test_the_announced_ranges_are_those_that_are_kept(served):
    station, _ = served
    request = mavlink.MAV_CMD_REQUEST_MESSAGE
    number = mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION
    assert station.command(request, number) == ACCEPTED
    announced = station.hear("GIMBAL_MANAGER_INFORMATION")
    pitch, yaw = math.degrees(announced.pitch_max), math.degrees(announced.yaw_min)
    for ends in ((pitch, 0.0), (0.0, yaw)):
        assert station.point(*ends) == ACCEPTED
        station.await_attitude(0, *ends)
    assert station.point(pitch + 1.0, 0.0) == DENIED
    assert station.point(0.0, yaw - 1.0) == DENIED
    assert station.point(0, 0) == ACCEPTED
    station.await_attitude(0, 0, 0)


def test_a_command_without_control_says_how_to_take_it(daemon):
    with gimbal(daemon.socket) as station:
        assert station.point(0, 0) == DENIED
        assert station.command(CONFIGURE, 1.5, 1, 0, 0, 0, 0, 1) == DENIED
    assert station.errors.startswith(
        "orientd: a command of the component 245/190 is denied: it must first take control, by "
        "MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE\n"
    )
