"""Chunks from the ring to the driver: poses with positions, reports, and nonsense."""

import random
from math import inf, nan, pi, sin

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig
from setpoint_checker import reached

from orientd.driver import ZERO
from orientd.floats import difference, exp, norm
from orientd.servo.tracking.chunk_report import read_report
from orientd.servo.tracking.chunks import publish_chunk
from orientd.stream.records import (
    CHUNK_POSES,
    KNOT_FLOATS,
    Answer,
    Command,
    NoteKind,
    Sample,
    ServoState,
)

NS = 1_000_000_000
LIMITS = TERMS


def playing(**options):
    rig = Rig(**options)
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK, servo_limits=LIMITS)[0] is Answer.DONE
    return rig


def swing(t):
    return exp((0.3 * sin(2.0 * t), 0.0, 0.0)), (0.1 * sin(3.0 * t), 0.05 * sin(2.0 * t), 0.0)


def chunk(rig, begin_ns, count=20, hz=30, motion=swing, observed_ns=0):
    stamps = [begin_ns + round(k / hz * NS) for k in range(count)]
    samples = [Sample(stamp, q, None, p) for stamp in stamps for q, p in [motion(stamp / NS - 1.0)]]
    publish_chunk(rig.memory.chunks, samples, LIMITS, observed_ns)


def test_orientation_and_position_are_where_the_poses_are():
    rig = playing()
    for _ in range(10):
        chunk(rig, rig.clock.now_ns() - NS // 10)
        rig.run(125)
    apart = 0.0
    for _ in range(100):
        rig.run()
        last = rig.driver.setpoints[-1]
        q, position = swing(last.time_ns / NS - 1.0)
        assert norm(difference(q, last.q)) < 1e-4
        apart = max(apart, np.linalg.norm(np.subtract(position, last.position)))
    assert apart < 1e-4
    assert read_report(rig.memory.chunks).lag < 1e-4


def test_the_acceleration_of_the_position_is_continuous():
    rig = playing()
    for k in range(12):
        shift = 0.02 * (-1) ** k
        chunk(
            rig,
            rig.clock.now_ns(),
            motion=lambda t, s=shift: (swing(t)[0], (0.1 * t + s, 0.0, 0.0)),
        )
        rig.run(100)
    rig.run(500)
    setpoints = rig.driver.setpoints
    found = reached([s.q for s in setpoints], [s.position for s in setpoints], PERIOD)
    assert all(size <= 1.001 * getattr(LIMITS, name) for name, size in found.items())
    places = np.array([s.position for s in setpoints])
    jerk = np.linalg.norm(np.diff(places, 3, axis=0), axis=1).max() / PERIOD**3
    assert jerk <= 1.001 * LIMITS.linear_acceleration / (2.0 * PERIOD)


def test_it_reports_what_became_of_the_chunks():
    rig = playing()
    ring = rig.memory.chunks
    assert read_report(ring).longest_inference is None
    chunk(rig, rig.clock.now_ns() - NS // 6 - 1)
    rig.run(50)
    report = read_report(ring)
    assert (report.live, report.stale, report.starved) == (14, 6, 0)
    chunk(
        rig, rig.clock.now_ns(), motion=lambda t: (exp((0.3 * sin(2.0 * t) + 0.05, 0.0, 0.0)), ZERO)
    )
    rig.run(1)
    report = read_report(ring)
    assert report.largest_seam == pytest.approx(0.05, abs=0.01)
    assert 0.04 < report.largest_position_seam < 0.08
    assert report.longest_inference == pytest.approx(19 / 30 - 1 / 6 - 0.1, abs=0.01)
    rig.run(1000)
    chunk(rig, rig.clock.now_ns())
    rig.run()
    assert read_report(ring).starved == 1
    rig.ask(Command.STOP)
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.ask(Command.TRACK, servo_limits=LIMITS)[0] is Answer.DONE
    assert read_report(ring).stale == 0


def test_a_chunk_that_waits_is_not_played_in_the_next_stream():
    rig = playing()
    chunk(rig, rig.clock.now_ns() + NS)
    rig.run(5)
    assert rig.ask(Command.TRACK, servo_limits=LIMITS)[0] is Answer.DONE
    before = rig.cycle.q
    rig.run(1000)
    assert rig.cycle.q == before


def test_what_the_limits_cut_off_is_told():
    rig = playing()
    chunk(rig, rig.clock.now_ns(), motion=lambda t: (exp((0.0, 0.0, 1.0 * sin(2 * pi * t))), ZERO))
    rig.run(300)
    assert read_report(rig.memory.chunks).largest_behind > 0.1


def test_poses_faster_than_the_limits_leave_a_lag():
    rig, speed = playing(), 1.2 * LIMITS.velocity
    begin = rig.clock.now_ns() / NS - 1.0
    for _ in range(8):
        now_ns = rig.clock.now_ns()
        chunk(rig, now_ns - NS // 10, motion=lambda t: (exp((0.0, 0.0, speed * (t - begin))), ZERO))
        rig.run(60)
    report, turned = read_report(rig.memory.chunks), rig.driver.setpoints[-1].q
    # As fast as the limits allow, but for the beginning.
    assert difference((1.0, 0.0, 0.0, 0.0), turned)[2] > 0.9 * LIMITS.velocity * 480 * PERIOD
    assert 0.1 < report.lag < report.behind / speed


def test_positions_faster_than_the_limits_are_behind_by_a_distance_and_a_delay():
    rig, speed = playing(), 1.2 * LIMITS.linear_velocity
    begin = rig.clock.now_ns() / NS - 1.0
    for _ in range(8):
        now_ns = rig.clock.now_ns()
        chunk(rig, now_ns - NS // 10, motion=lambda t: (exp(ZERO), (0.0, 0.0, speed * (t - begin))))
        rig.run(60)
    report, last = read_report(rig.memory.chunks), rig.driver.setpoints[-1]
    missing = speed * (last.time_ns / NS - 1.0 - begin) - last.position[2]
    assert report.position_behind == pytest.approx(missing, abs=3.0 * PERIOD * speed)
    assert report.largest_position_behind >= report.position_behind > 0.05
    assert 0.05 < report.position_lag < report.position_behind / speed
    assert report.lag == 0.0


def test_positions_that_are_anchored_anew_cost_no_more_than_a_part_of_the_limits():
    rig, rng = playing(), random.Random(3)
    for _ in range(12):
        aside = rng.uniform(-0.06, 0.06)
        begin_ns = rig.clock.now_ns() - NS // 10
        chunk(rig, begin_ns, 30, motion=lambda t, x=aside: (exp(ZERO), (0.1 * t + x, 0.0, 0.0)))
        rig.run(150)
    along = np.array([s.position[0] for s in rig.driver.setpoints])
    assert along[-1] == pytest.approx(0.1 * len(along) * PERIOD, abs=0.1)
    assert np.abs(np.diff(along, 2)).max() / PERIOD**2 < 0.98 * LIMITS.linear_acceleration


def test_chunks_that_are_all_late_have_starved_the_device():
    rig = playing()
    for _ in range(3):
        chunk(rig, rig.clock.now_ns() - NS)
        rig.run(50)
    assert read_report(rig.memory.chunks).starved == 3


def test_a_late_chunk_starves_no_device_that_has_poses_left():
    rig = playing()
    chunk(rig, rig.clock.now_ns())
    rig.run(10)
    chunk(rig, rig.clock.now_ns() - NS)
    rig.run(10)
    assert read_report(rig.memory.chunks).starved == 0


def test_poses_that_ran_out_are_counted():
    rig = playing()
    for _ in range(3):
        chunk(rig, rig.clock.now_ns(), count=8)
        rig.run(250)
    assert read_report(rig.memory.chunks).starved == 2


def test_a_chunk_that_comes_in_time_for_a_pause_of_the_poses_has_starved_nothing():
    rig = playing()
    begin_ns = rig.clock.now_ns()
    chunk(rig, begin_ns, count=10)
    rig.run(5)
    chunk(rig, begin_ns + 3 * NS, count=10, observed_ns=begin_ns)
    rig.run(1400)
    report = read_report(rig.memory.chunks)
    assert (report.starved, report.stale, report.live) == (0, 1, 10)
    assert report.longest_inference == pytest.approx(0.3, abs=1e-6)


def test_the_longest_inference_is_that_of_the_chunk_with_the_least_time():
    rig = playing()
    begin_ns = rig.clock.now_ns()
    chunk(rig, begin_ns, count=31)
    for after, observed in ((0.5, 0.0), (0.8, 0.75)):
        rig.run(round((begin_ns + after * NS - rig.clock.now_ns()) / NS / PERIOD))
        chunk(rig, rig.clock.now_ns(), count=7, observed_ns=begin_ns + round(observed * NS))
    rig.run(2)
    # The second one ends 0.7 s and the third 1 s after the beginning.
    report = read_report(rig.memory.chunks)
    assert report.starved == 1
    assert report.longest_inference == pytest.approx(1.0, abs=1e-6)


def test_the_latency_is_from_the_observation_to_the_first_setpoint_of_a_chunk():
    rig = playing()
    assert read_report(rig.memory.chunks).latency_p50 is None
    chunk(rig, rig.clock.now_ns())
    rig.run(5)
    assert read_report(rig.memory.chunks).latency_p95 is None
    for k in range(20):
        before_ns = round((0.3 if k == 7 else 0.1 + 0.001 * k) * NS)
        chunk(rig, rig.clock.now_ns() - before_ns, observed_ns=rig.clock.now_ns() - before_ns)
        rig.run(50)
    report = read_report(rig.memory.chunks)
    assert report.latency_p50 == pytest.approx(0.110, abs=2.0 * PERIOD)
    assert report.latency_p95 == pytest.approx(0.119, abs=2.0 * PERIOD)
    ahead_ns = rig.clock.now_ns() + NS // 5
    for _ in range(300):
        chunk(rig, rig.clock.now_ns() + NS // 5, observed_ns=ahead_ns - NS // 2)
        rig.run(101)
        ahead_ns = rig.clock.now_ns() + NS // 5
    # A chunk for later counts from its first pose on, and older ones no longer.
    assert read_report(rig.memory.chunks).latency_p50 == pytest.approx(0.5, abs=2.0 * PERIOD)


def test_a_lag_ends_with_the_motion_of_the_poses_and_counts_stay():
    rig, speed = playing(), 1.2 * LIMITS.velocity
    begin = rig.clock.now_ns() / NS - 1.0
    chunk(rig, rig.clock.now_ns(), motion=lambda t: (exp((0.0, 0.0, speed * (t - begin))), ZERO))
    rig.run(round(19 / 30 / PERIOD))
    late = read_report(rig.memory.chunks)
    rig.run(10)
    turned = norm(difference(rig.driver.setpoints[-1].q, exp((0.0, 0.0, speed * 19 / 30))))
    assert read_report(rig.memory.chunks).behind == pytest.approx(turned, abs=0.02)
    rig.run(1000)
    report = read_report(rig.memory.chunks)
    assert late.lag > 0.05
    assert (report.lag, report.position_lag, report.largest_behind) == (
        0.0,
        0.0,
        late.largest_behind,
    )
    assert report.behind < 1e-6


def test_a_target_ends_the_figures_of_the_poses_and_not_their_counts():
    rig = playing()
    chunk(rig, rig.clock.now_ns() - NS // 10, motion=lambda t: (exp((0.0, 0.0, 40.0 * t)), ZERO))
    rig.run(50)
    before = read_report(rig.memory.chunks)
    now_ns = rig.clock.now_ns()
    rig.memory.targets.publish(now_ns, now_ns + NS, 1.0, 0.0, 0.0, 0.0, *ZERO, *(nan, nan, nan))
    rig.run(5)
    report = read_report(rig.memory.chunks)
    assert before.behind > 0.0 == report.behind == report.lag
    assert (report.stale, report.live) == (before.stale, before.live) == (4, 16)
    assert report.largest_behind >= before.behind


def farthest_from_swing(rig, cycles):
    """Let cycles pass; return the largest angle between what is sent and the swing, rad."""
    apart = 0.0
    for _ in range(cycles):
        rig.run()
        last = rig.driver.setpoints[-1]
        apart = max(apart, norm(difference(swing(last.time_ns / NS - 1.0)[0], last.q)))
    return apart


def test_a_chunk_of_256_poses_is_played_to_its_end():
    rig = playing()
    begin_ns = rig.clock.now_ns() + NS // 100
    assert CHUNK_POSES == 256
    chunk(rig, begin_ns, count=256, hz=100)
    rig.run(250)
    assert farthest_from_swing(rig, 1000) < 1e-4
    rig.run(500)
    q, position = swing((begin_ns + round(255 / 100 * NS)) / NS - 1.0)
    assert norm(difference(rig.driver.setpoints[-1].q, q)) < 1e-6
    assert np.linalg.norm(np.subtract(position, rig.driver.setpoints[-1].position)) < 1e-6


def test_a_chunk_far_ahead_waits_for_its_time():
    rig = playing()
    chunk(rig, rig.clock.now_ns() + 2 * NS, motion=lambda t: (exp((0.0, 0.0, 0.3)), ZERO))
    rig.run(700)
    assert rig.driver.setpoints[-1].q == (1.0, 0.0, 0.0, 0.0)
    rig.run(800)
    assert norm(difference(rig.driver.setpoints[-1].q, exp((0.0, 0.0, 0.3)))) < 1e-6


def test_chunks_that_are_sent_at_once_one_behind_another_are_all_played():
    rig = playing()
    begin_ns = rig.clock.now_ns() + 2 * NS
    for k in range(8):
        chunk(rig, begin_ns + k * NS, count=30)
    late = [Sample(rig.clock.now_ns() - NS, swing(0.0)[0], None, None)]
    rig.run(10)
    publish_chunk(rig.memory.chunks, late, LIMITS)
    rig.run(2500)
    assert farthest_from_swing(rig, 2000) < 1e-4


def test_a_chunk_replaces_waiting_ones_that_begin_later():
    rig = playing()
    now_ns = rig.clock.now_ns()
    chunk(rig, now_ns + 5 * NS, motion=lambda _: (exp((0.3, 0.0, 0.0)), ZERO))
    rig.run(2)
    chunk(rig, now_ns + NS)
    rig.run(2)
    rig.run(4500)
    rest = swing((now_ns + NS + round(19 / 30 * NS)) / NS - 1.0)[0]
    assert norm(difference(rig.driver.setpoints[-1].q, rest)) < 1e-6


def test_a_stop_ends_it_within_the_limits():
    rig = playing()
    chunk(rig, rig.clock.now_ns(), count=60)
    rig.run(200)
    assert rig.ask(Command.STOP)[0] is Answer.DONE
    assert rig.run_until(lambda servo: not servo.is_moving) < 150
    assert rig.cycle.state is ServoState.HOLDING


def test_no_chunk_however_wild_breaks_a_limit():
    rng, rig = random.Random(5), playing()
    floats = (nan, inf, -inf, 1e300, 1e-300, 0.0, 1.0, -3.0)
    for _ in range(300):
        count = rng.choice([0, 1, 5, CHUNK_POSES, 10**6])
        now = rig.clock.now_ns()
        times = [
            now + rng.choice([0, k, -k, 10**7 * k, 2**61, -(2**61)]) for k in range(CHUNK_POSES)
        ]
        numbers = []
        for _ in range(CHUNK_POSES):
            q = exp(tuple(rng.gauss(0.0, 1.0) for _ in range(3)))
            scale = rng.choice([0.0, 1.0, 1e3, 1e150])
            numbers += [*q, *(rng.gauss(0.0, scale) for _ in range(KNOT_FLOATS - 4))]
        if rng.random() < 0.3:
            numbers[rng.randrange(len(numbers))] = rng.choice(floats)
        if rng.random() < 0.5:
            times.sort()
        rig.memory.chunks.publish(
            rng.choice([0, now, -(2**63)]), count, rng.random() < 0.5, *times, *numbers
        )
        rig.run(rng.choice([1, 5, 40]))
        if rig.cycle.state is ServoState.FAULT:
            break
    setpoints = rig.driver.setpoints
    found = reached([s.q for s in setpoints], [s.position for s in setpoints], PERIOD)
    assert all(size <= 1.001 * getattr(LIMITS, name) for name, size in found.items())
    assert not rig.notes(NoteKind.FAULT)


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9, 1e-6, 1e-5])
@pytest.mark.parametrize("goal", [(0.5, 0.7, -0.6), (0.0, 0.0, 0.3), (-1.5, 0.4, 2.0)])
def test_poses_that_stand_still_leave_no_lag(goal, noise):
    rig, chance, lags = playing(), random.Random(5), []
    for _ in range(4):
        chunk(
            rig,
            rig.clock.now_ns() - NS // 10,
            count=16,
            motion=lambda t: (exp(tuple(x + noise * chance.gauss(0, 1) for x in goal)), ZERO),
        )
        for _ in range(100):
            rig.run()
            lags.append(read_report(rig.memory.chunks).lag)
    rig.run(1500)
    assert max(lags) < 1.0
    assert rig.servo.state is ServoState.TRACKING
    assert not rig.notes(NoteKind.FAULT)
    assert norm(difference(rig.driver.setpoints[-1].q, exp(goal))) < 1e-3
