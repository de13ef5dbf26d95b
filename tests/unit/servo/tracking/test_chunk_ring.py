"""Chunks from the ring to the driver: poses with positions, reports, and nonsense."""

import random
from math import inf, nan, pi, sin

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig
from setpoint_checker import reached

from orientd.driver import ZERO
from orientd.floats import difference, exp, norm
from orientd.servo.tracking.chunks import publish_chunk, read_report
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


def chunk(rig, begin_ns, count=20, hz=30, motion=swing):
    stamps = [begin_ns + round(k / hz * NS) for k in range(count)]
    samples = [Sample(stamp, q, None, p) for stamp in stamps for q, p in [motion(stamp / NS - 1.0)]]
    publish_chunk(rig.memory.chunks, samples, LIMITS)


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
    assert read_report(ring).least_left is None
    chunk(rig, rig.clock.now_ns() - NS // 6 - 1)
    rig.run(50)
    report = read_report(ring)
    assert (report.live, report.stale, report.starved) == (14, 6, 0)
    chunk(
        rig, rig.clock.now_ns(), motion=lambda t: (exp((0.3 * sin(2.0 * t) + 0.05, 0.0, 0.0)), ZERO)
    )
    rig.run(1)
    report = read_report(ring)
    assert report.seam == pytest.approx(0.05, abs=0.01)
    assert report.least_left == pytest.approx(19 / 30 - 1 / 6 - 0.1, abs=0.01)
    rig.run(1000)
    chunk(rig, rig.clock.now_ns())
    rig.run()
    report = read_report(ring)
    assert report.starved == 1
    assert report.least_left < -1.0
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
    assert read_report(rig.memory.chunks).farthest > 0.1


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
    assert report.position_farthest >= report.position_behind > 0.05
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
    apart = 0.0
    for _ in range(2000):
        rig.run()
        last = rig.driver.setpoints[-1]
        apart = max(apart, norm(difference(swing(last.time_ns / NS - 1.0)[0], last.q)))
    assert apart < 1e-4


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
        rig.memory.chunks.publish(count, rng.random() < 0.5, *times, *numbers)
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
