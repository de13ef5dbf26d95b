"""Every fault of the emulated bus at many random moments: ridden out, or typed and recovered."""

import math
import random

import pytest

from emulated_dynamixel import FaultKind, ReplyFault
from orientd.errors import DeviceError, DeviceFaultError, FeedbackError, LinkError

MS = 1_000_000
MOMENTS = [
    pytest.param(range(3), id="few"),
    pytest.param(range(3, 50), id="many", marks=pytest.mark.slow),
]


def _reply(kind, **settings):
    return lambda rig, servo: rig.bus.faults.add(servo, ReplyFault(kind, **settings))


def _unplug(rig, servo):
    rig.port.is_plugged = False


def _power(rig, servo):
    rig.servo(servo).disconnect(rig.clock.now_ns())
    rig.servo(servo).connect(rig.clock.now_ns())


def _stall(rig, servo):
    rig.servo(servo).shaft.load = 1.0


def _jam(rig, servo):
    rig.servo(servo).shaft.jammed = True


RIDDEN_OUT = {
    "one dropped": _reply(FaultKind.DROP, remaining=1),
    "three dropped": _reply(FaultKind.DROP, remaining=3),
    "one corrupted": _reply(FaultKind.CORRUPT, remaining=1),
    "one truncated": _reply(FaultKind.TRUNCATE, remaining=1),
    "one late": _reply(FaultKind.DELAY, remaining=1, delay_ns=13 * MS),
    "a tenth dropped": _reply(FaultKind.DROP, probability=0.1, remaining=20),
}
FATAL = {
    "silent": (_reply(FaultKind.DROP), FeedbackError),
    "all corrupted": (_reply(FaultKind.CORRUPT), FeedbackError),
    "all truncated": (_reply(FaultKind.TRUNCATE), FeedbackError),
    "all late": (_reply(FaultKind.DELAY, delay_ns=30 * MS), FeedbackError),
    "cable off": (lambda rig, s: rig.servo(s).disconnect(rig.clock.now_ns()), FeedbackError),
    "supply interrupted": (_power, (FeedbackError, DeviceFaultError)),
    "adapter unplugged": (_unplug, LinkError),
    "overload": (lambda rig, s: rig.servo(s).fail(1 << 5, rig.clock.now_ns()), DeviceFaultError),
    "overheated": (lambda rig, s: rig.servo(s).fail(1 << 2, rig.clock.now_ns()), DeviceFaultError),
    "voltage": (lambda rig, s: rig.servo(s).fail(1 << 0, rig.clock.now_ns()), DeviceFaultError),
    "electric shock": (
        lambda rig, s: rig.servo(s).fail(1 << 4, rig.clock.now_ns()),
        DeviceFaultError,
    ),
    "jammed": (_jam, DeviceFaultError),
    "stalled": (_stall, DeviceFaultError),
    "watchdog": (lambda rig, s: rig.clock.advance(800 * MS), DeviceFaultError),
}


def heal(rig, servo):
    """Take every cause away."""
    rig.bus.faults.clear()
    rig.port.is_plugged = True
    it = rig.bus.servos[servo - 1]
    it.connect(rig.clock.now_ns())
    it.shaft.jammed = False
    it.shaft.load = 0.0
    rig.clock.advance(500 * MS)


def path(offset):
    def at(k):
        t = (k + offset) * 0.01
        return [1.2 * math.sin(t), 0.8 * math.sin(0.7 * t), 0.5 * math.sin(1.3 * t)]

    return at


def started(rig, seed):
    rng = random.Random(seed)
    it = rig(seed=seed, fast_read=rng.choice(["on", "off"]))
    it.start()
    moment = rng.randrange(1, 100)
    it.run(moment, path(0))
    return it, rng.randrange(1, 4), moment


def assert_sane(rig):
    """No reading is a jump, none is the zero that a failed read would be."""
    previous = None
    for feedback in rig.seen:
        if feedback is None:
            continue
        for value in feedback.joints:
            assert abs(value + math.pi) > 0.5
        if previous is not None and feedback.time_ns > previous.time_ns:
            span = (feedback.time_ns - previous.time_ns) * 1e-9
            for a, b in zip(feedback.joints, previous.joints, strict=True):
                assert abs(a - b) <= 4.9 * span + 0.03
        previous = feedback


@pytest.mark.parametrize("name", RIDDEN_OUT)
@pytest.mark.parametrize("moments", MOMENTS)
def test_passing_fault_is_ridden_out(rig, name, moments):
    for seed in moments:
        it, servo, moment = started(rig, seed)
        RIDDEN_OUT[name](it, servo)
        it.run(120, path(moment))
        assert it.driver._group.lost >= 1 or name == "a tenth dropped"
        it.bus.faults.clear()
        it.run(10)
        assert it.driver._group.lost_in_a_row == 0
        assert it.seen[-1].joints == pytest.approx(it.joints, abs=0.1)
        assert_sane(it)


@pytest.mark.parametrize("name", FATAL)
@pytest.mark.parametrize("moments", MOMENTS)
def test_lasting_fault_is_typed_and_reset_recovers(rig, name, moments):
    inject, kind = FATAL[name]
    for seed in moments:
        it, servo, moment = started(rig, seed)
        inject(it, servo)
        with pytest.raises(kind):
            it.run(400, path(moment))
        goals = it.goals()
        try:
            it.driver.disable()
        except DeviceError:
            it.driver.disable()  # never twice
        stands = [round(s.shaft.position) for s in it.bus.servos]
        for goal, was, stand in zip(it.goals(), goals, stands, strict=True):
            assert abs(goal - was) < 60 or goal == stand
        assert_sane(it)
        heal(it, servo)
        it.driver.reset()
        it.enable()
        assert all(abs(goal - 2048) < 1.5 / 6.28 * 4096 for goal in it.goals())
        it.seen.clear()
        it.run(30)
        assert it.seen[-1].joints == pytest.approx(it.joints, abs=0.01)
        assert all(s.is_torque_on for s in it.bus.servos)


def test_faulty_servo_leaves_the_others_where_they_are(rig):
    it, _, moment = started(rig, 7)
    it.servo(2).disconnect(it.clock.now_ns())
    with pytest.raises(FeedbackError, match="servo 2"):
        it.run(400, path(moment))
    with pytest.raises(DeviceError):
        it.driver.disable()
    places = [it.servo(k).value("goal position") for k in (1, 3)]
    it.clock.advance(2_000_000_000)
    it.bus.advance(it.clock.now_ns())
    assert [round(it.servo(k).shaft.position) for k in (1, 3)] == places


def test_lost_answers_are_a_fault_before_feedback_timeout_and_watchdog(rig):
    """As shipped: 100 Hz, and an adapter with the latency timer it leaves the factory with."""
    it = rig(rate_hz=100, latency_ms=16.0)
    it.start()
    it.run(50)
    good_ns = it.driver._group.time_ns
    it.bus.faults.add(2, ReplyFault(FaultKind.DROP))
    with pytest.raises(FeedbackError, match=r"10 readings lost in a row.*servo 2 \(pitch\)"):
        it.run(200)
    assert it.clock.now_ns() - good_ns < 300 * MS
    # Goals were sent all the while, so no servo has stopped by itself.
    assert [it.value(k, "bus watchdog") for k in (1, 2, 3)] == [25, 25, 25]


@pytest.mark.parametrize("fast_read", ["on", "off"])
def test_a_dead_line_is_not_put_down_to_one_servo(rig, fast_read):
    it = rig(fast_read=fast_read)
    it.start()
    for servo in (1, 2, 3):
        it.bus.faults.add(servo, ReplyFault(FaultKind.DROP))
    with pytest.raises(FeedbackError, match=r"of servos 1, 2, 3 alike"):
        it.run(200)


@pytest.mark.parametrize("pause_ms", [150, 300, 450])
def test_pause_of_a_busy_machine_is_ridden_out(rig, pause_ms):
    it = rig(rate_hz=100, latency_ms=16.0)
    it.start()
    it.run(50)
    it.clock.advance(pause_ms * MS)
    it.run(50)
    assert it.driver._group.lost_in_a_row == 0
    assert [it.value(k, "bus watchdog") for k in (1, 2, 3)] == [25, 25, 25]


def test_what_kept_a_reset_from_recovering_stays_what_is_told(rig):
    it = rig()
    it.start()
    it.servo(2).disconnect(it.clock.now_ns())
    with pytest.raises(LinkError, match=r"servo 2 \(pitch\) does not answer") as refused:
        it.driver.reset()
    with pytest.raises(LinkError) as told:
        it.driver.read()
    assert str(told.value) == str(refused.value)


def test_damage_in_a_fast_answer_is_blamed_on_its_servo(rig):
    it = rig(fast_read="on")
    it.start()
    it.run(5)
    it.bus.faults.add(2, ReplyFault(FaultKind.CORRUPT))
    with pytest.raises(FeedbackError, match=r"most often servo 2 \(pitch\)"):
        it.run(50)


def test_a_lost_answer_at_the_start_hides_no_servo(rig):
    it = rig()
    it.bus.faults.add(2, ReplyFault(FaultKind.DROP, remaining=1))
    it.start()
    assert [it.value(k, "torque enable") for k in (1, 2, 3)] == [1, 1, 1]


def test_a_current_above_that_of_the_servo_is_refused(rig):
    it = rig("ZY", axes=[{"id": 1, "limits_deg": [-90, 90], "current_limit": 1.0}, {"id": 2}])
    it.servo(1).write(38, (100).to_bytes(2, "little"), it.clock.now_ns())
    with pytest.raises(
        DeviceFaultError, match=r"servo 1 .* gives 0\.27 A at most, current_limit is 1 A"
    ):
        it.driver.open()
