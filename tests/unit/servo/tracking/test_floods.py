"""More targets than cycles, and late ones before many: work per cycle and lag are bounded."""

from math import cos, pi, sin

import pytest
from rig import PERIOD, PERIOD_NS, TERMS, Rig
from setpoint_checker import reached
from tracking_world import NS, World, servo_limits

from orientd import kernels
from orientd.floats import difference, exp, norm
from orientd.servo.tracking import forecast
from orientd.stream.records import LEFT_OUT_WORD, NOT_GIVEN, Answer, Command, ServoState

AMPLITUDE, HERTZ = 0.349, 0.25


def swing(t):
    """Return angle and rate of the target, rad and rad/s."""
    turn = 2.0 * pi * HERTZ
    return AMPLITUDE * sin(turn * t), AMPLITUDE * turn * cos(turn * t)


def flood(per_cycle, *, has_velocity, seconds=4.0):
    """Send targets with the stamps of their arrival; return the rig and the errors, rad."""
    rig, errors = Rig(), []
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK)[0] is Answer.DONE
    begun = rig.clock.now_ns()
    for cycle in range(round(seconds / PERIOD)):
        for k in range(per_cycle):
            time_ns = rig.clock.now_ns() + (k + 1) * PERIOD_NS // per_cycle - 1
            angle, rate = swing((time_ns - begun) / NS)
            omega = (0.0, 0.0, rate) if has_velocity else NOT_GIVEN
            rig.memory.targets.publish(
                time_ns, time_ns + NS // 2, *exp((0.0, 0.0, angle)), *omega, *NOT_GIVEN
            )
        rig.run()
        if cycle * PERIOD > 1.0:
            last = rig.driver.setpoints[-1]
            angle, _ = swing((last.time_ns - begun) / NS)
            errors.append(norm(difference(last.q, exp((0.0, 0.0, angle)))))
    assert rig.servo.state is ServoState.TRACKING
    return rig, errors


@pytest.mark.parametrize("has_velocity", [False, True])
@pytest.mark.parametrize("per_cycle", [1, 2, 3, 4, 8, 16, 30])
def test_targets_in_a_busy_loop_are_followed_within_a_cycle_or_so(per_cycle, has_velocity):
    rig, errors = flood(per_cycle, has_velocity=has_velocity)
    fastest = 2.0 * pi * HERTZ * AMPLITUDE
    assert max(errors) < 2.0 * PERIOD * fastest
    given, left_out = rig.memory.targets.head, rig.memory.targets.words[LEFT_OUT_WORD]
    # About one is used in a cycle; all others are counted.
    assert 0 <= given - left_out - given / per_cycle <= 0.1 * given / per_cycle
    rig.ask(Command.STOP)
    rig.run_until(lambda servo: not servo.is_moving)
    setpoints = rig.driver.setpoints
    found = reached([s.q for s in setpoints], [s.position for s in setpoints], PERIOD)
    assert all(size <= 1.001 * getattr(TERMS, name) for name, size in found.items())


def test_targets_that_the_ring_has_lost_are_counted():
    rig, _ = flood(1, has_velocity=False, seconds=0.1)
    ring = rig.memory.targets
    before = ring.words[LEFT_OUT_WORD]
    for _ in range(ring.capacity + 100):
        time_ns = rig.clock.now_ns()
        ring.publish(time_ns, time_ns + NS, 1.0, 0.0, 0.0, 0.0, *NOT_GIVEN, *NOT_GIVEN)
    rig.run(round(ring.capacity / 20_000 / PERIOD) + 2)
    assert ring.words[LEFT_OUT_WORD] - before >= ring.capacity


def test_a_late_target_before_many_changes_few_in_a_cycle(monkeypatch):
    counted, whole = [0, 0], kernels.fit_samples

    def fit_samples(samples, *others):
        counted[0], counted[1] = counted[0] + 1, max(counted[1], len(samples))
        whole(samples, *others)

    monkeypatch.setattr(kernels, "fit_samples", fit_samples)
    world = World(servo_limits(2.5, 17.0, 8500.0))
    # Within the time by which a late target is only late, far denser than any sender needs.
    begin, gap = world.now_ns + NS, 140_000_000 // 5000
    for k in range(5000):
        assert not world.take(exp((0.0, 0.0, 1e-5 * k)), time_ns=begin + k * gap, live=10.0)
    for _ in range(400):
        world.step()
    late = begin + gap + gap // 2
    assert not world.take(exp((0.0, 0.0, 1.5e-5)), time_ns=late, live=10.0)
    for _ in range(800):
        counted[0] = 0
        world.step()
        assert counted[0] <= 1
    assert counted[1] <= forecast.WINDOW
    assert norm(difference(world.guard.q, exp((0.0, 0.0, 0.05)))) < 1e-4
