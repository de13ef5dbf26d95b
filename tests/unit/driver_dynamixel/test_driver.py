"""The driver on the emulated bus: start, cycle, supervision, end."""

import math

import numpy as np
import pytest

from orientd.driver import Setpoint
from orientd.errors import DeviceFaultError, LinkError
from orientd.rotation import angle


def sway(rig, seconds, amplitude=(0.5, 0.3, 0.4), rate=1.0):
    """Stream a smooth motion of all axes and return the feedback of every cycle."""
    count = round(seconds * 1e9 / rig.period_ns)
    found = []
    for k in range(count):
        t = k * rig.period_ns * 1e-9
        share = (1 - math.cos(rate * t)) / 2
        found.append(rig.cycle([a * share for a in amplitude[: len(rig.bus.servos)]]))
    return found


def test_start_from_anywhere_takes_the_place_as_goal(rig):
    it = rig()
    for number, position in enumerate((1000.0, 3000.0, 2500.0)):
        it.servo(number + 1).shaft.position = position
    feedback = it.start()
    assert it.goals() == [1000, 3000, 2500]
    expected = [(p - 2048) * 2 * math.pi / 4096 for p in (1000, 3000, 2500)]
    assert feedback.joints == pytest.approx(expected)


def test_servos_are_set_as_the_sheet_of_settings_says(gimbal):
    for number in (1, 2, 3):
        names = ("return delay time", "operating mode", "drive mode", "profile velocity",
                 "profile acceleration", "status return level", "bus watchdog")  # fmt: skip
        assert [gimbal.value(number, n) for n in names] == [0, 4, 0, 193, 0, 2, 25]


def test_settings_that_are_right_are_not_written_again(gimbal):
    writes = []
    for servo in gimbal.bus.servos:
        original = servo.write
        servo.write = lambda a, c, n, original=original: (writes.append(a), original(a, c, n))[1]
    gimbal.driver.reset()
    assert not [address for address in writes if address < 64]
    assert all(servo.is_torque_on for servo in gimbal.bus.servos)


def test_watchdog_is_armed_last(rig):
    it = rig()
    order = []
    for servo in it.bus.servos:
        original = servo.write
        servo.write = lambda a, c, n, o=original, i=servo.id: (order.append((a, i, c)), o(a, c, n))[
            1
        ]
    it.start()
    armed = [k for k, (address, _, content) in enumerate(order) if address == 98 and content[0]]
    assert armed == list(range(len(order) - 3, len(order)))
    goal = [k for k, (address, *_) in enumerate(order) if address == 116]
    torque = [k for k, (address, _, content) in enumerate(order) if address == 64 and content[0]]
    assert all(g < t for g, t in zip(goal, torque, strict=True))


def test_gimbal_follows_and_reports(gimbal):
    feedback = sway(gimbal, 3.0)[-1]
    assert gimbal.driver._group.lost == 0
    assert feedback.joints == pytest.approx(gimbal.joints, abs=0.05)
    assert np.linalg.norm(feedback.omega_body) > 0.01
    assert 0 < gimbal.clock.now_ns() - feedback.time_ns < 2 * gimbal.period_ns


def test_cycle_never_waits_for_an_answer_that_comes_in_time(gimbal):
    for k in range(200):
        before = gimbal.next_ns
        gimbal.cycle([0.001 * k, 0, 0])
        assert gimbal.clock.now_ns() == before + gimbal.period_ns


def test_gear_direction_and_zero_are_applied(rig):
    axes = [
        {"id": 1, "gear": 2.0, "direction": -1, "zero_deg": 30.0, "limits_deg": [-90, 90],
         "velocity_deg": 100},
        {"id": 2, "limits_deg": [-90, 90]},
    ]  # fmt: skip
    it = rig("ZY", axes=axes)
    assert it.start().joints == pytest.approx((math.radians(30), 0.0))
    for k in range(100):
        it.cycle([math.radians(30 + 0.1 * k), 0.0])
    # 9.9 degrees of the axis are 19.8 of the servo, the other way round.
    assert it.goals()[0] == round(2048 - 19.8 / 360 * 4096)


def test_axis_goes_on_counting_across_turns(rig):
    axes = [{"id": 1, "limits_deg": [-720, 720]}, {"id": 2, "limits_deg": [-90, 90]}]
    it = rig("ZY", axes=axes)
    it.start()
    for k in range(600):
        it.cycle([math.radians(k), 0.0])
    assert it.goals()[0] == round(2048 + 599 / 360 * 4096)


@pytest.mark.parametrize(
    ("order", "rms", "worst", "places"),
    [
        ("ZYX", 0.044, 0.093, 50),
        pytest.param("ZYX", 0.044, 0.093, 150, marks=pytest.mark.slow),
        ("ZY", 0.033, 0.061, 150),
    ],
)
def test_standstill_error_is_that_of_the_ticks(rig, order, rms, worst, places):
    """Through the whole chain: orientation asked, servos at rest, orientation reported."""
    axes = [{"id": k + 1, "limits_deg": [-100, 100]} for k in range(len(order))]
    it = rig(order, axes=axes, follow_tolerance_deg=300, is_paced=False, rate_hz=50)
    it.start()
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(places):
        target = np.deg2rad(rng.uniform(-60, 60, len(order)))
        start = np.array(it.joints)
        steps = int(np.max(np.abs(target - start)) / 0.07) + 1
        for k in range(steps):
            it.cycle((start + (target - start) * (k + 1) / steps).tolist())
        for _ in range(20):
            feedback = it.cycle()
        errors.append(np.rad2deg(float(angle(feedback.q, it.q))))
    assert np.sqrt(np.mean(np.square(errors))) <= rms * 1.05
    assert max(errors) <= worst * 1.05


def test_goal_outside_the_limits_is_refused_and_nothing_sent(rig):
    it = rig(axes=[{"id": k, "limits_deg": [-20, 20]} for k in (1, 2, 3)])
    it.start()
    with pytest.raises(DeviceFaultError, match=r"z would be at 20\.6"):
        it.run(300, lambda k: [math.radians(0.1 * k), 0, 0])
    assert it.goals()[0] <= 2048 + 20.5 / 360 * 4096


def test_disable_holds_and_enable_goes_on_from_there(gimbal):
    sway(gimbal, 1.5)
    goals = gimbal.goals()
    gimbal.driver.disable()
    for _ in range(200):
        gimbal.cycle(write=False)
    assert gimbal.goals() == goals
    assert all(servo.is_torque_on for servo in gimbal.bus.servos)
    assert [gimbal.value(k, "bus watchdog") for k in (1, 2, 3)] == [0, 0, 0]
    gimbal.driver.enable()
    assert gimbal.goals() == goals


def test_park_can_leave_it_holding(rig):
    it = rig(at_end="hold")
    it.start()
    it.driver.disable()
    it.driver.park()
    it.driver.close()
    assert all(servo.is_torque_on for servo in it.bus.servos)


def test_close_leaves_it_holding(rig):
    it = rig()
    it.start()
    sway(it, 0.5)
    goals = it.goals()
    it.driver.close()
    assert it.goals() == goals
    assert all(servo.is_torque_on for servo in it.bus.servos)
    assert [it.value(k, "bus watchdog") for k in (1, 2, 3)] == [0, 0, 0]


def test_servo_that_does_not_answer_is_named_at_the_start(rig):
    it = rig()
    it.servo(2).disconnect(0)
    with pytest.raises(LinkError, match=r"servo 2 \(pitch\) does not answer"):
        it.driver.open()


def test_other_model_is_named_at_the_start(rig):
    it = rig(models=["xm430", "xm430", "xl330"], axes=[{"id": k} for k in (1, 2, 3)])
    with pytest.raises(DeviceFaultError, match=r"servo 3 \(x\) is model 1200, configured is XM430"):
        it.driver.open()


def test_fast_reads_are_left_to_servos_that_know_them(rig):
    it = rig()
    it.servo(2)._memory[6] = 44
    it.driver.open()
    assert not it.driver._group._is_fast
    assert it.driver.advice == ["servo 2 has firmware 44, fast reads need 45"]
    other = rig(fast_read="on")
    other.servo(2)._memory[6] = 44
    with pytest.raises(DeviceFaultError, match="firmware 44"):
        other.driver.open()


def test_fast_reads_begin_with_the_firmware_that_knows_them(rig):
    it = rig()
    it.servo(2)._memory[6] = 45
    it.driver.open()
    assert it.driver._group._is_fast
    assert not it.driver.notices()[3:]


def test_line_that_is_too_slow_for_the_rate_is_refused(rig):
    it = rig(baud=57600)
    for servo in it.bus.servos:
        servo._memory[8] = 1
    it.port.baudrate = 57600
    with pytest.raises(LinkError, match=r"a cycle takes 1\d\.\d\d ms on the line at 57600 baud"):
        it.driver.open()


def test_hardware_error_is_a_fault_that_says_what(gimbal):
    gimbal.servo(2).fail(1 << 5, gimbal.clock.now_ns())
    with pytest.raises(DeviceFaultError, match=r"servo 2 \(pitch\) reports overload"):
        gimbal.run(4)
    gimbal.driver.disable()
    with pytest.raises(DeviceFaultError, match="reset it"):
        gimbal.driver.enable()
    gimbal.driver.reset()
    gimbal.driver.enable()
    assert gimbal.servo(2).is_torque_on


def test_jam_is_noticed_before_the_servo_gives_up(gimbal):
    gimbal.servo(1).shaft.jammed = True
    with pytest.raises(DeviceFaultError, match=r"yaw\) does not follow: it is \d+\.\d deg behind"):
        gimbal.run(400, lambda k: [0.002 * k, 0, 0])


def test_write_without_an_open_port_is_a_link_error(rig):
    with pytest.raises(LinkError, match="not open"):
        rig().driver.write(Setpoint(0, (1.0, 0.0, 0.0, 0.0)))


def test_servo_left_tripped_by_a_killed_process_does_not_set_off_again(rig):
    """Its goal is still in it when the next process clears the watchdog."""
    gimbal = rig(watchdog_ms=200)
    gimbal.start()
    gimbal.run(60, lambda k: [0.015 * k, 0, 0])
    gimbal.servo(1)._memory[116:120] = (9000).to_bytes(4, "little")
    gimbal.clock.advance(1_000_000_000)
    place = gimbal.value(1, "present position")
    assert gimbal.value(1, "goal position") == 9000
    assert place < 4000
    gimbal.driver.reset()
    gimbal.clock.advance(1_000_000_000)
    assert gimbal.value(1, "present position") == pytest.approx(place, abs=12)
