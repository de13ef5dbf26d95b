"""Voltage, temperature and current of every servo; what may be overwritten in it."""

import itertools

import pytest

from orientd.errors import DeviceFaultError


def health(gimbal):
    """Look until the servos have been read again."""
    gimbal.run(120)
    return {part.name: part for part in gimbal.driver.health()}


def test_every_servo_tells_what_it_measures_and_when(gimbal):
    gimbal.servo(2).supply, gimbal.servo(3).temperature = 118, 41
    told = health(gimbal)
    assert [told[name].voltage for name in told] == pytest.approx([12.0, 11.8, 12.0])
    assert [told[name].temperature for name in told] == [32.0, 32.0, 41.0]
    assert all(abs(part.current) < 0.1 and not part.warning for part in told.values())
    age = gimbal.clock.now_ns() - told["yaw"].time_ns
    assert 0 < age < 600_000_000


def test_reading_health_costs_no_reading_and_no_goal(gimbal):
    bus = gimbal.driver._group.bus
    packets, request = [], bus.request
    bus.request = lambda rows, **more: (packets.append(rows), request(rows, **more))
    gimbal.seen.clear()
    gimbal.run(401, lambda k: [0.001 * k, 0, 0])
    long = [rows for rows in packets if rows[0][2] == 19]
    # Twice a second in 2 s at 200 Hz, in the place of the read that would have been.
    assert 4 <= len(long) <= 5
    assert len(packets) == 401
    times = [feedback.time_ns for feedback in gimbal.seen[5:]]
    assert max(b - a for a, b in itertools.pairwise(times)) == gimbal.period_ns


@pytest.mark.parametrize(
    ("model", "change", "said"),
    [
        ("xm430", {"temperature": 71}, "servo 1 (yaw) has 71 degrees C, at 80 it gives up"),
        ("xl330", {"temperature": 61}, "servo 1 (yaw) has 61 degrees C, at 70 it gives up"),
        ("xm430", {"supply": 98}, "has 9.8 V, below 9.5 V it reports an error"),
        ("xm430", {"supply": 156}, "has 15.6 V, above 16.0 V it reports an error"),
    ],
)
def test_a_warning_comes_before_the_servo_gives_up(rig, model, change, said):
    gimbal = rig("ZY", models=[model, model])
    gimbal.start()
    for name, value in change.items():
        setattr(gimbal.servo(1), name, value)
    told = health(gimbal)
    assert said in told["yaw"].warning
    assert not told["pitch"].warning
    assert gimbal.servo(1).is_torque_on


def test_a_load_that_a_servo_hardly_bears_is_warned_of(gimbal):
    gimbal.servo(2).shaft.load = 0.95
    assert not health(gimbal)["pitch"].warning  # for a moment it may be
    for _ in range(2):
        told = health(gimbal)
        gimbal.driver.health()
    assert "servo 2 (pitch) needs 3.05 A for long, 3.21 A is its limit" in told["pitch"].warning


def test_a_servo_without_a_measured_current_tells_none(rig):
    gimbal = rig("ZY", models=["xl430-w250", "xm430"])
    gimbal.start()
    told = health(gimbal)
    assert (told["yaw"].current, told["yaw"].voltage) == (None, 12.0)
    assert told["pitch"].current is not None


def test_what_is_overwritten_is_said_and_refused_unless_permitted(rig):
    refused = rig("ZY", overwrite=False)
    refused.servo(2).write(20, (500).to_bytes(4, "little"), refused.clock.now_ns())
    before = [bytes(servo._memory) for servo in refused.bus.servos]
    with pytest.raises(DeviceFaultError) as raised:
        refused.driver.open()
    for text in (
        "servo 1 (yaw) has operating mode 3; servo 2 (pitch) has homing offset 500 and operating "
        "mode 3;", "overwrite = ['homing_offset', 'operating_mode']",
    ):  # fmt: skip
        assert text in str(raised.value)
    assert [bytes(servo._memory)[:64] for servo in refused.bus.servos] == [m[:64] for m in before]
    it = rig("ZY")
    it.driver.open()
    assert list(it.driver.notices()) == [
        "servo 1 (yaw): operating mode 3 is set to 4",
        "servo 2 (pitch): operating mode 3 is set to 4",
    ]
    it.driver.reset()
    assert not it.driver.notices()


def test_what_was_overwritten_before_an_error_is_said(rig):
    axes = [
        {"id": 1, "name": "yaw", "model": "xm430", "limits_deg": [-90, 90]},
        {"id": 2, "name": "pitch", "model": "xm430", "limits_deg": [-90, 90], "current_limit": 2.4},
    ]
    it = rig("ZY", axes=axes)
    it.servo(2).write(38, (100).to_bytes(2, "little"), it.clock.now_ns())
    with pytest.raises(DeviceFaultError, match="at most, current_limit is"):
        it.driver.open()
    assert list(it.driver.notices()) == [
        "servo 1 (yaw): operating mode 3 is set to 4",
        "servo 2 (pitch): operating mode 3 is set to 5",
    ]


def limited(rig, ampere):
    axes = [
        {"id": 1, "name": "yaw", "current_limit": ampere, "limits_deg": [-400, 400]},
        {"id": 2, "name": "pitch"},
    ]
    it = rig("ZY", axes=axes)
    it.start()
    return it


def test_current_limit_makes_a_servo_give_way(rig):
    it = limited(rig, 0.8)
    names = ("operating mode", "goal current", "current limit")
    assert [it.value(1, name) for name in names] == [5, 297, 1193]
    assert it.value(2, "operating mode") == 4
    # Half of what it could lift at most is more than it may.
    it.servo(1).shaft.load = it.servo(2).shaft.load = 0.5
    with pytest.raises(DeviceFaultError, match=r"yaw.* does not follow"):
        it.run(400, lambda k: [0.004 * k, 0.004 * k])
    assert it.value(1, "present position") == 2048
    assert it.value(1, "present current") * 0.00269 == pytest.approx(0.8, abs=0.01)


def test_current_limit_keeps_the_turns(rig):
    it = limited(rig, 0.8)
    for k in range(300):
        it.cycle([0.015 * k, 0.0])
    it.run(40)
    assert it.value(1, "present position") > 4096
    it.driver.disable()
    it.driver.reset()
    assert it.driver.enable().joints[0] == pytest.approx(0.015 * 299, abs=0.01)
