"""Measurements of a motion, from cycles as the servo publishes them."""

import numpy as np
import pytest
from direct_planners import recorded

from orientd import rotation
from orientd.daemon.device.meter import Histogram, MotionMeter
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.recorder.columns import CYCLES
from orientd.stream.records import CYCLE_RECORD, CycleFlag, ServoState
from orientd.stream.ring import RecordRing

PERIOD = 0.002
FIRST = 700  # index in the path ring
NUMBER = 3


@pytest.fixture(scope="module")
def motion():
    """A motion that ends between two cycles, with velocity at both ends."""
    turns = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.3], [0.0, 0.2, 0.5]])
    keyframes = [
        Keyframe(tuple(q), time=time)
        for q, time in zip(rotation.exp(turns), (0.0, 0.5, 1.0007), strict=True)
    ]
    request = MotionRequest(
        keyframes, start_velocity=(0.1, 0.2, 0.3), end_velocity=(0.4, -0.3, 0.2), approach=True
    )
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)


def sent(motion):
    """Return the cycles of *motion* as planned, with a hold before and after it."""
    count = motion.record_count
    places = np.concatenate([np.zeros(3, int), np.arange(1, count), np.full(3, count - 1)])
    samples = motion.sample(places * PERIOD)
    cycles = np.zeros(len(places), CYCLES)
    cycles["index"] = np.arange(len(places))
    cycles["deadline_ns"] = cycles["index"] * 2_000_000
    cycles["path_index"] = FIRST + places
    cycles["motion"] = NUMBER
    cycles["state"] = ServoState.HOLDING
    cycles["state"][3 : 3 + count - 2] = ServoState.STREAMING
    cycles["speed"] = 1.0
    cycles["flags"] = 3
    for name in ("q", "omega_body", "alpha_body", "position"):
        cycles[f"sent_{name}"] = getattr(samples, name)
    cycles["measured_q"] = samples.q
    return cycles


def measure(motion, cycles, *, lead=0.0):
    """Return the statistics of *cycles*, of which 64 come between two measurements."""
    view = memoryview(bytearray(RecordRing.bytes_needed(CYCLE_RECORD, len(cycles))))
    ring = RecordRing(view, CYCLE_RECORD, len(cycles))
    meter = MotionMeter(recorded(motion), NUMBER, FIRST, ring, lead=lead)
    for index, cycle in enumerate(cycles):
        ring.append(cycle.tobytes())
        if index % 64 == 63:
            assert not meter.measure()
    meter.end()
    found = meter.statistics()
    assert meter.measure()
    return found


def test_stops_for_a_stall_are_counted_and_not_differentiated(motion):
    cycles, rate = sent(motion)[:103], 0.5
    cycles["state"][3:] = ServoState.STREAMING
    turned = 0.5 * rate * (np.arange(51) * PERIOD) ** 2
    turns = np.zeros((103, 3))
    turns[2:53, 2], turns[52:, 2] = turned, turned[-1] + turned
    cycles["sent_q"] = rotation.exp(turns)
    assert measure(motion, cycles).acceleration == pytest.approx(0.05 / PERIOD, rel=0.05)
    cycles["flags"][53] |= CycleFlag.FROM_REST
    found = measure(motion, cycles)
    assert found.stalls == 1
    assert found.acceleration == pytest.approx(rate, rel=1e-6)


def test_a_wrong_end_velocity_is_measured(motion):
    cycles = sent(motion)
    cycles["sent_omega_body"] += [0.003, 0.0, 0.004]
    found = measure(motion, cycles)
    assert found.start_velocity_error == pytest.approx(0.005, rel=1e-6)
    assert found.end_velocity_error == pytest.approx(0.005, rel=1e-6)


def test_what_comes_after_the_end_of_a_motion_is_not_measured(motion):
    cycles = sent(motion)
    view = memoryview(bytearray(RecordRing.bytes_needed(CYCLE_RECORD, len(cycles))))
    ring = RecordRing(view, CYCLE_RECORD, len(cycles))
    meter = MotionMeter(recorded(motion), NUMBER, FIRST, ring)
    for index, cycle in enumerate(cycles):
        ring.append(cycle.tobytes())
        if index == 99:
            meter.end()
    assert meter.statistics().cycles == 100 - 3


def test_a_step_off_the_plan_is_measured(motion):
    cycles = sent(motion)
    cycles["sent_q"][100] = rotation.multiply(cycles["sent_q"][100], rotation.exp([0.0, 0.0, 0.01]))
    found = measure(motion, cycles)
    assert found.path_error == pytest.approx(0.01, rel=1e-6)
    assert found.jerk > 8500.0


def test_overruns_and_missed_deadlines_are_those_of_the_motion(motion):
    cycles = sent(motion)
    cycles["overruns"] = 7
    cycles["missed"] = 2
    cycles["overruns"][200:] += 1
    cycles["missed"][300:] += 3
    found = measure(motion, cycles)
    assert (found.overruns, found.missed) == (1, 3)


def test_percentiles_are_right_to_a_percent():
    histogram = Histogram()
    durations = np.random.default_rng(1).gamma(2.0, 30_000.0, 20_000).astype(np.int64)
    for duration in durations.tolist():
        histogram.add(duration)
    for percent in (50.0, 99.0, 99.9):
        exact = np.percentile(durations, percent, method="inverted_cdf")
        assert histogram.percentile_ns(percent) == pytest.approx(exact, rel=0.011)
    assert histogram.largest_ns == durations.max()


def test_nothing_measured_is_nothing():
    histogram = Histogram()
    assert histogram.percentile_ns(99.0) == 0.0
    for duration in (-5, 0):
        histogram.add(duration)
    assert histogram.percentile_ns(50.0) <= 1.0


def test_feedback_is_compared_with_no_setpoint_from_before_the_device_was_enabled(motion):
    cycles, behind = sent(motion), 20
    cycles["feedback_time_ns"] = cycles["deadline_ns"]
    cycles["measured_q"][behind:] = cycles["sent_q"][:-behind]
    cycles["measured_q"][:behind] = cycles["sent_q"][0]
    cycles["flags"][:2] = CycleFlag.FEEDBACK
    cycles["sent_q"][:2] = (0.8, 0.6, 0.0, 0.0)
    assert measure(motion, cycles, lead=behind * PERIOD).tracking_error < 1e-9
