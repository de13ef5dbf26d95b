from math import sqrt

import numpy as np
import pytest
from planned import rotations
from reference.differences import brake_rate

from orientd.floats import difference
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE
from orientd.planner.certify.measuring import STATE, measure
from orientd.planner.planning import plan
from orientd.planner.recorded import STATE_FLOATS, states_at
from orientd.planner.state import State
from orientd.rotation import conjugate, exp, log, multiply

H = 0.004


def walk(count=300, seed=1):
    """Return a smooth walk of orientations and positions: rates from filtered noise."""
    random = np.random.default_rng(seed)
    window = np.hanning(41)
    noise = random.normal(size=(3, count)) * np.hanning(count) ** 2
    noise[:, :40] = noise[:, -40:] = 0.0
    omega = np.stack([np.convolve(part, window, "same") for part in noise], axis=1)
    q = [np.array(rotations(random, 2, 0.1)[0])]
    for rate in omega[1:] * H * 0.2:
        q.append(multiply(q[-1], exp(rate)))
    return np.array(q), np.cumsum(omega, axis=0) * H * 0.1


def look(q, p, limits=DEFAULT_LIMITS, velocity=np.nan, **changes):
    rows = np.full((len(q), STATE), np.nan)
    rows[:, : q.shape[1]], rows[:, 10:13], rows[:, 13:] = q, p, velocity
    before = np.repeat(q[:1, :4], 3, axis=0), np.repeat(p[:1], 3, axis=0)
    return measure(rows, len(q), H, limits, **{"before": before, **changes})


def plainly(q):
    """Return the peaks and their indices in plain floats, as a device would find them."""
    setpoints = [tuple(row) for row in q.tolist()]
    setpoints = [setpoints[0], *setpoints, *setpoints[-1:] * 3]
    omega = alpha = (0.0, 0.0, 0.0)
    peaks = [(0.0, 0)] * 3
    for k in range(1, len(setpoints)):
        w = tuple(c / H for c in difference(setpoints[k - 1], setpoints[k]))
        a = tuple((x - y) / H for x, y in zip(w, omega, strict=True))
        j = tuple((x - y) / H for x, y in zip(a, alpha, strict=True))
        omega, alpha = w, a
        for place, rate in enumerate((w, a, j)):
            size = sqrt(sum(c * c for c in rate))
            peaks[place] = max(peaks[place], (size, k - 1))
    return peaks


@pytest.mark.parametrize("count", [300, 150])
def test_peaks_are_those_of_backward_differences_with_their_times(count):
    q, p = (part[:count] for part in walk())
    peaks = look(q, p)
    for peak, (value, index) in zip(
        (peaks.velocity, peaks.acceleration, peaks.jerk), plainly(q), strict=True
    ):
        assert peak.value == pytest.approx(value, rel=1e-6)
        assert peak.time == pytest.approx(index * H)


@pytest.mark.parametrize("count", [300, 150])
def test_linear_peaks_are_those_of_the_position_with_their_times(count):
    q, p = (part[:count] for part in walk())
    peaks = look(q, p)
    padded = np.concatenate([p[:1], p, p[-1:]])
    v = np.linalg.norm(np.diff(padded, axis=0), axis=1) / H
    a = np.linalg.norm(np.diff(padded, n=2, axis=0), axis=1) / H**2
    assert peaks.linear_velocity.value == pytest.approx(v.max())
    assert peaks.linear_velocity.time == pytest.approx(v.argmax() * H)
    assert peaks.linear_acceleration.value == pytest.approx(a.max())
    assert peaks.linear_acceleration.time == pytest.approx((a.argmax() + 1) * H)


def test_linear_peaks_hold_at_every_phase_of_the_setpoints():
    q, p = walk()
    velocity = np.gradient(p, H, axis=0)
    # A push within a period, and one that ends there.
    velocity[100:200] += [0.05, 0.0, 0.0]
    p[100:] += np.minimum(np.arange(200) + 0.3, 100.0)[:, None] * [0.05 * H, 0.0, 0.0]
    peaks = look(q, p, velocity=velocity, tolerance=1.0)
    rows = np.zeros((len(q), STATE_FLOATS))
    rows[:, :4], rows[:, 10:13], rows[:, 13:16] = q[0], p, velocity
    rows[-1, 13:16] = 0.0
    parts = 32
    fine = states_at(rows, np.arange((len(q) - 1) * parts + 1) / parts, H)[:, 10:13]
    held = np.repeat(fine[:1], parts, axis=0), fine, np.repeat(fine[-1:], parts, axis=0)
    fine = np.concatenate(held)
    first = (fine[parts:] - fine[:-parts]) / H
    second = (first[parts:] - first[:-parts]) / H
    for peak, rate in ((peaks.linear_velocity, first), (peaks.linear_acceleration, second)):
        sizes = np.linalg.norm(rate, axis=1)
        assert sizes.max() <= peak.value <= 1.002 * sizes.max()
        assert peak.on_records == pytest.approx(sizes[::parts].max())
        assert peak.on_records < peak.value


def test_the_signs_of_quaternions_make_no_difference():
    q, p = walk()
    flipped = q * np.random.default_rng(2).choice([-1.0, 1.0], size=(len(q), 1))
    assert look(flipped, p).jerk.value == pytest.approx(look(q, p).jerk.value)


def test_a_jump_at_the_start_is_seen_against_what_the_device_held():
    q, p = walk()
    away = np.repeat(q[:1] * [1, -1, -1, -1], 3, axis=0), np.repeat(p[:1], 3, axis=0)
    assert look(q, p, before=away).velocity.time == 0.0


@pytest.mark.parametrize("place", [0, 1])
def test_what_the_device_did_before_the_first_record_is_not_held_against_it(place):
    q, p = walk()
    plain = look(q, p)
    earlier, places = np.repeat(q[:1], 3, axis=0), np.repeat(p[:1], 3, axis=0)
    earlier[: place + 1] *= [1, -1, -1, -1]
    places[: place + 1] += 1.0
    peaks = look(q, p, before=(earlier, places))
    # Nothing that the past alone is in; of the rest what it still has a part in.
    assert (peaks.velocity, peaks.linear_velocity) == (plain.velocity, plain.linear_velocity)
    assert peaks.jerk.time == 0.0
    for peak, other in (
        (peaks.acceleration, plain.acceleration),
        (peaks.linear_acceleration, plain.linear_acceleration),
    ):
        assert (peak.time == 0.0) is (place == 1)
        assert (peak == other) is (place == 0)


def with_rates(q):
    """Return orientations with the rates of their central differences."""
    turns = log(multiply(conjugate(q[:-1]), q[1:])) / H
    omega = np.zeros((len(q), 3))
    omega[1:-1] = 0.5 * (turns[1:] + turns[:-1])
    return np.hstack([q, omega, np.gradient(omega, H, axis=0)])


def test_what_is_drawn_between_the_records_is_told_apart_from_what_is_on_them():
    q, p = walk()
    plain, full = look(q, p), look(with_rates(q), p)
    for name in ("velocity", "acceleration", "jerk"):
        on_records, peak = getattr(plain, name), getattr(full, name)
        assert on_records.on_records == on_records.value == pytest.approx(peak.on_records)
        assert peak.value >= peak.on_records


def test_peaks_of_components_are_those_of_the_turns_about_the_bodys_axes():
    q, p = walk()
    axes = {"velocity": [1.0, 2.0, 3.0], "acceleration": [4.0, 5.0, 6.0], "jerk": [7.0, 8.0, 9.0]}
    peaks = look(q, p, DEFAULT_LIMITS.with_rates(axes))
    setpoints = np.concatenate([q[:1], q, np.repeat(q[-1:], 3, axis=0)])
    rates = log(multiply(conjugate(setpoints[:-1]), setpoints[1:])) / H
    for name, limits in axes.items():
        row = getattr(peaks, f"axis_{name}")
        assert [peak.value for peak in row] == pytest.approx(np.abs(rates).max(axis=0), rel=1e-6)
        assert [peak.limit for peak in row] == limits
        rates = np.diff(np.concatenate([np.zeros((1, 3)), rates]), axis=0) / H


def test_components_have_peaks_where_they_have_limits_alone():
    q, p = walk()
    peaks = look(q, p)
    assert peaks.axis_velocity == peaks.axis_acceleration == peaks.axis_jerk == ()


def test_a_device_that_stays_brakes_as_quickly_as_any_from_the_first_record_on():
    q, p = (np.repeat(part[:1], 20, axis=0) for part in walk())
    peaks = look(q, p, tolerance=1.0)
    assert (peaks.brake_rate, peaks.brake_time) == (FASTEST_BRAKE_RATE, 0.0)


def test_of_peaks_that_are_as_large_the_first_is_named():
    peaks = look(np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)), np.zeros((20, 3)))
    for peak in (peaks.velocity, peaks.acceleration, peaks.jerk, peaks.linear_velocity):
        assert (peak.value, peak.time) == (0.0, 0.0)


def test_the_brake_rate_is_that_of_the_position_where_that_is_the_least():
    q, p = walk()
    q[:] = q[0]
    most = 1.3 * look(q, p).linear_acceleration.value
    peaks = look(q, p, Limits.partial(linear_acceleration=most), tolerance=1.0)
    places = np.concatenate([p[:1], p[:1], p, np.repeat(p[-1:], 3, axis=0)])
    v = np.diff(places, axis=0) / H
    a = np.diff(v, axis=0) / H
    # The velocity at a setpoint is the mean of the differences before and after it.
    speeds = 0.5 * (v[1:] + v[:-1])
    rates = [brake_rate(*one, 0.0, most, np.inf, step=1e-8) for one in zip(speeds, a, strict=True)]
    place = int(np.argmin(rates))
    assert peaks.brake_rate == pytest.approx(rates[place], rel=1e-6)
    assert peaks.brake_rate < FASTEST_BRAKE_RATE
    assert peaks.brake_time == pytest.approx(place * H)


def test_the_device_holds_with_no_rates_after_the_last_record():
    q, p = walk()
    q, p = with_rates(q)[:150], p[:150]
    held = np.repeat(q[-1:], 3, axis=0) * ([1] * 4 + [0] * 6)
    longer = np.concatenate([q, held]), np.concatenate([p, np.repeat(p[-1:], 3, axis=0)])
    assert look(*longer, rests=(False, False)) == look(q, p)


def test_the_device_held_with_no_rates_before_the_first_record():
    q, p = walk()
    q, p = with_rates(q)[150:], p[150:]
    held = np.repeat(q[:1], 3, axis=0) * ([1] * 4 + [0] * 6)
    longer = np.concatenate([held, q]), np.concatenate([np.repeat(p[:1], 3, axis=0), p])
    before = held[:, :4], longer[1][:3]
    found, wanted = look(q, p, before=before), look(*longer, before=None)
    for name in ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration"):
        peak, other = getattr(found, name), getattr(wanted, name)
        assert (peak.value, peak.on_records) == (other.value, other.on_records)
        assert peak.time == pytest.approx(other.time - 3 * H)


def test_nothing_is_drawn_between_setpoints_of_unknown_rates():
    q, p = walk()
    full = with_rates(q)
    whole = look(full, p)
    begin = round(whole.jerk.time / H) - 20
    part = look(full[begin:], p[begin:], before=(q[begin - 3 : begin], p[begin - 3 : begin]))
    assert part.jerk.value == whole.jerk.value
    assert part.jerk.time == pytest.approx(whole.jerk.time - begin * H)


def test_without_history_every_difference_inside_counts():
    q = exp(np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [1.5e-3, 0.0, 0.0]]))
    p = np.array([[5.0, 0.0, 0.0], [5.0, 1e-3, 0.0], [5.0, 1.5e-3, 0.0]])
    peaks = look(q, p, before=None, rests=(False, False))
    for peak, power, value in (
        (peaks.velocity, 1, 1e-3),
        (peaks.acceleration, 2, 5e-4),
        (peaks.linear_velocity, 1, 1e-3),
        (peaks.linear_acceleration, 2, 5e-4),
    ):
        assert peak.value == pytest.approx(value / H**power)
        assert peak.time == pytest.approx(power * H)


def test_without_history_only_differences_inside_count():
    q, p = walk()
    inside = look(q, p, before=None, rests=(False, False))
    assert inside.velocity.value <= look(q, p).velocity.value
    lone = look(q[:1], p[:1], before=None, rests=(False, False))
    assert lone.velocity.value == 0.0
    pair = look(q[150:152], p[150:152], before=None, rests=(False, False))
    assert pair.linear_velocity.value > 0.0 == pair.linear_acceleration.value


def test_what_is_not_a_number_is_the_peak():
    q, p = walk()
    q[150] = np.nan
    assert np.isnan(look(q, p).velocity.value)


def shortest_stop(speed, push, pull, jerk):
    """Return the time from a speed and its rate of change to rest, with bounded rates of both."""
    peak = sqrt(jerk * speed + 0.5 * push * push)
    if peak <= pull:
        return (push + 2.0 * peak) / jerk
    bends = (push * push - pull * pull) / (2.0 * jerk) - pull * pull / (2.0 * jerk)
    return (push + pull) / jerk + (speed + bends) / pull + pull / jerk


@pytest.mark.parametrize(
    ("velocity", "acceleration", "jerk"),
    [(1.0, 2.0, 40.0), (0.5, 2.0, 4.0), (2.0, 3.0, 30.0), (2.0, 17.0, 8500.0), (0.1, 5.0, 20.0)],
)
def test_the_usual_time_of_a_stop_is_that_of_a_straight_path(velocity, acceleration, jerk):
    limits = Limits(velocity, acceleration, jerk, 1.0, 10.0)
    request = MotionRequest([Keyframe(tuple(exp([0.0, 0.0, 3.0])))])
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    motion = plan(request, start=start, limits=limits, period=H)
    records = motion.sample(np.arange(motion.record_count) * H)
    turning = zip(records.omega_body[:, 2], records.alpha_body[:, 2], strict=True)
    took = max(shortest_stop(*one, acceleration, jerk) for one in turning if one[0] > 0.0)
    assert motion.certificate.usual_stop_time == pytest.approx(took, rel=1e-6)
