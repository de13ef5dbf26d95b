"""The ranges of a MAVLink gimbal: those that it announces are those that it keeps."""

import math

import pytest

pytest.importorskip("pymavlink")

from orientd_mavlink.ranges import Ranges
from orientd_mavlink.setpoint import NEUTRAL, RETRACT, YAW_IN_EARTH_FRAME, Wish, level

NAN = math.nan
RATE = math.radians(140.0)
AXES = [{"limits_deg": [-270, 270]}, {"limits_deg": [-100, 100]}, {"limits_deg": [-120, 120]}]
GIMBAL = Ranges.of_device({"axes": AXES}, RATE)
TWO_AXES = Ranges.of_device({"axes": AXES[:2], "order": "ZY"}, RATE)
ARM = Ranges.of_device({}, RATE)
COMPASS = Ranges.of_device({"axes": [{"limits_deg": [-300, 0]}], "order": "Z"}, RATE)


def asked(pitch, yaw, *, rates=(NAN, NAN), flags=0):
    """Return the request of a pitch and a yaw, degrees."""
    pitch, yaw, *rates = map(math.radians, (pitch, yaw, *rates))
    return level(flags, (pitch, yaw), tuple(rates))


@pytest.mark.parametrize("ranges", [GIMBAL, TWO_AXES, ARM, COMPASS])
def test_every_end_that_is_announced_is_kept_and_a_degree_more_is_not(ranges):
    ends = ranges.announced()
    for axis in range(3):
        for end, beyond in ((ends[2 * axis], -1.0), (ends[2 * axis + 1], 1.0)):
            angles = [NAN] * 3
            angles[axis] = end
            assert ranges.problem(Wish(0, angles), 0.0) == ""
            angles[axis] = end + math.radians(beyond)
            assert ranges.problem(Wish(0, angles), 0.0)


@pytest.mark.parametrize(
    ("ranges", "wish", "problem"),
    [
        (GIMBAL, asked(-4500, 0), "a pitch of -4500 degrees is denied: the gimbal announces -100 "),
        (GIMBAL, asked(0, 24435), "a yaw of 24435 degrees is denied: the gimbal announces -270 "),
        (GIMBAL, asked(0, -300), "a yaw of -300 degrees is denied: the gimbal announces -270 to "),
        (ARM, asked(-100, 0), "a pitch of -100 degrees is denied: the gimbal announces -90 to 90 "),
        (ARM, asked(1e30, 0), "a pitch of 1e+30 degrees is denied"),
        (TWO_AXES, Wish(0, (0.1, 0.0, 0.0)), "a roll of 5.72958 degrees is denied: the gimbal "),
        (COMPASS, asked(NAN, -30), "a yaw of -30 degrees is denied: the gimbal announces 0 to 300"),
        (GIMBAL, asked(0, 0, rates=(150, 0)), "a pitch rate of 150 degrees/s is denied: expected "),
        (GIMBAL, asked(NAN, NAN, rates=(0, -1e9)), "a yaw rate of -1e+09 degrees/s is denied"),
        (
            GIMBAL,
            asked(0, 400, flags=YAW_IN_EARTH_FRAME),
            "a yaw of 400 degrees from north is denied: the gimbal announces -270 to 270 degrees "
            "from forward",
        ),
    ],
)
def test_a_request_beyond_the_ranges_is_denied_by_name(ranges, wish, problem):
    assert ranges.problem(wish, 0.0).startswith(problem)


@pytest.mark.parametrize(
    ("ranges", "wish", "heading"),
    [
        (GIMBAL, asked(NAN, NAN), 0.0),
        (COMPASS, asked(NAN, -100), 0.0),  # 260 degrees
        (GIMBAL, asked(-20, 350, flags=YAW_IN_EARTH_FRAME), 20.0),
        (COMPASS, asked(NAN, 10, flags=YAW_IN_EARTH_FRAME), 90.0),  # -80 from forward: 280
        (GIMBAL, asked(0, 0, flags=NEUTRAL | RETRACT), 0.0),
        (GIMBAL, asked(-4500, 0, flags=RETRACT), 0.0),
        # Behind, upside down: the attitude of a pitch of 95 degrees.
        (GIMBAL, Wish(0, [math.radians(one) for one in (180, 85, 180)]), 0.0),
    ],
)
def test_a_request_within_the_ranges_is_taken_in_any_turn_and_form(ranges, wish, heading):
    assert ranges.problem(wish, math.radians(heading)) == ""
