"""A device keeps pointing at moving targets and from a moving base, within its limits."""

from math import atan2, cos, hypot, pi, sin
from random import Random

import pytest
from pointing_world import (
    GIMBAL,
    IDENTITY,
    LIMITS,
    NS,
    ZERO,
    Session,
    amplitude,
    angle,
    as_user,
    axis_of,
    exp,
    multiply,
    off_line,
    rate_of,
)

from orientd.client.prediction import turning
from orientd.driver import AxisLimits
from orientd.errors import RequestError, StaleBaseError
from orientd.floats import difference
from orientd.mechanism import Gimbal
from orientd.rotation import Quaternion

SLOW = pytest.mark.slow
RATES = [0.1, pytest.param(0.3, marks=SLOW), pytest.param(1.0, marks=SLOW), 2.0]
SECONDS, SETTLED = 6.0, 2.5
DEVICES = [(LIMITS, 500), (GIMBAL, 100)]


def swung(hz, limits):
    """Return a turn about a skew axis, a sine whose rates take 0.6 of the limits."""
    a, w = amplitude(hz, limits), 2.0 * pi * hz
    return lambda t: exp(tuple(a * sin(w * t) * x for x in (0.36, -0.48, 0.8)))


def largest(session, error, seconds=SECONDS):
    """Run a session and return its largest error once it has settled."""
    start_ns, worst = session.now_ns, [0.0]

    def look(point):
        t = (session.now_ns - start_ns) / NS
        if t > SETTLED:
            worst.append(error(point.q, t))

    session.run(seconds, look)
    return max(worst)


def base_error(hz, limits, rate_hz, *, with_rate, **stream):
    """Return how far a line fixed in the world is missed while the base swings, rad."""
    session, base = Session(limits, rate_hz), swung(hz, limits)

    def sample(t, stamp_ns):
        omega = rate_of(base, t) if with_rate else None
        session.base(as_user(base(t)), angular_velocity=omega, time_ns=stamp_ns)

    session.now(lambda: session.look_at([30.0, 10.0, 5.0]))
    session.stream(SECONDS, sample, **stream)
    length = hypot(30.0, 10.0, 5.0)
    line = (30.0 / length, 10.0 / length, 5.0 / length)
    return largest(session, lambda q, t: off_line(multiply(base(t), q), line))


def point_error(hz, limits, rate_hz, *, with_rate, **stream):
    """Return how far a point that swings is missed, rad."""
    session, w = Session(limits, rate_hz), 2.0 * pi * hz
    a = amplitude(hz, limits, 0.5) * 20.0

    def place(t):
        return (20.0, a * sin(w * t), 0.3 * a * cos(w * t))

    def sample(t, stamp_ns):
        v = (0.0, a * w * cos(w * t), -0.3 * a * w * sin(w * t))
        session.look_at(place(t), velocity=v if with_rate else None, time_ns=stamp_ns)

    def error(q, t):
        x, y, z = place(t)
        length = hypot(x, y, z)
        return off_line(q, (x / length, y / length, z / length))

    session.stream(SECONDS, sample, **stream)
    return largest(session, error)


@pytest.mark.parametrize("hz", RATES)
@pytest.mark.parametrize(("limits", "rate_hz"), DEVICES)
@pytest.mark.parametrize(("with_rate", "most"), [(True, 3e-3), (False, 10e-3)])
def test_a_line_of_sight_stays_in_the_world_while_the_base_swings(
    hz, limits, rate_hz, with_rate, most
):
    assert base_error(hz, limits, rate_hz, with_rate=with_rate) < most


@pytest.mark.parametrize("hz", RATES)
@pytest.mark.parametrize(("limits", "rate_hz"), DEVICES)
@pytest.mark.parametrize(("with_rate", "most"), [(True, 3e-3), (False, 10e-3)])
def test_a_moving_point_is_followed(hz, limits, rate_hz, with_rate, most):
    assert point_error(hz, limits, rate_hz, with_rate=with_rate) < most


@pytest.mark.parametrize("jump", [1.5, 3.0, 6.0])
@pytest.mark.parametrize("rate_hz", [50, 100])
def test_a_base_that_is_hit_is_predicted_by_its_new_rate_at_once(rate_hz, jump):
    """Its angular velocity, as a gyroscope measures it, jumps between two samples."""
    base, angle, ahead = turning(), 0.0, 0.05
    for k in range(200):
        speed = 0.2 + (jump if k >= 100 else 0.0)
        stamp_ns = NS + round(k / rate_hz * NS)
        assert base.take(exp((0.0, 0.0, angle)), (0.0, 0.0, speed), stamp_ns)
        if k >= 100:
            q, rate = base.at(stamp_ns + round(ahead * NS))
            assert difference(exp((0.0, 0.0, angle + speed * ahead)), q) == pytest.approx(
                (0.0, 0.0, 0.0), abs=1e-6
            )
            assert rate == pytest.approx((0.0, 0.0, speed), abs=1e-6)
        angle += speed / rate_hz


@pytest.mark.parametrize("azimuth", [20.0, -100.0])
def test_the_roll_is_the_least_also_through_the_zenith(azimuth):
    session, spin = Session(), []
    last = [session.world.guard.q]

    def look(point):
        turn = difference(last[0], point.q)
        spin.append(abs(turn[0]))
        last[0] = point.q

    def sample(t, stamp_ns):
        session.point(azimuth, 60.0 + 20.0 * t, elevation_rate=20.0, time_ns=stamp_ns)

    session.stream(3.0, sample)
    session.run(2.9, look)
    assert max(spin[650:]) < 1e-6
    e, a = (pi * (60.0 + 20.0 * 2.9) / 180.0, azimuth * pi / 180.0)
    assert off_line(last[0], (cos(e) * cos(a), cos(e) * sin(a), sin(e))) < 1e-3


def test_a_given_roll_is_kept_while_the_point_moves():
    session = Session()

    def sample(t, stamp_ns):
        session.look_at([5.0, 2.0 * sin(t), 1.0], time_ns=stamp_ns, roll=10.0)

    session.stream(3.0, sample)
    session.run(3.0)
    q = session.world.guard.q
    y, z = axis_of(q, (0.0, 1.0, 0.0))[2], axis_of(q, (0.0, 0.0, 1.0))[2]
    assert atan2(y, z) == pytest.approx(10.0 * pi / 180.0, abs=1e-3)


@pytest.mark.parametrize(("axis", "vector"), [("y", (0.0, 1.0, 0.0)), ("z", (0.0, 0.0, 1.0))])
def test_another_axis_of_the_tool_points(axis, vector):
    session = Session()
    session.now(lambda: session.look_at([1.0, 2.0, 3.0], pointing_axis=axis))
    session.run(4.0)
    length = hypot(1.0, 2.0, 3.0)
    found = axis_of(session.world.guard.q, vector)
    assert found == pytest.approx((1.0 / length, 2.0 / length, 3.0 / length), abs=1e-6)


def test_a_point_that_is_given_once_is_reached_and_kept():
    session = Session()
    session.now(lambda: session.look_at([-1.0, 0.1, 0.0], velocity=[0.0, 0.0, 0.0]))
    session.run(10.0)
    assert off_line(session.world.guard.q, (-0.99503719, 0.099503719, 0.0)) < 1e-6


def test_a_moving_point_counts_for_its_time_to_live():
    session = Session()
    session.now(
        lambda: session.look_at([5.0, 0.0, 0.0], velocity=[0.0, 2.0, 0.0], time_to_live=0.3)
    )
    session.run(2.0)
    assert session.world.tracker.is_at_rest
    assert off_line(session.world.guard.q, (1.0, 0.0, 0.0)) < 0.4


FRAMES = {
    "mast": {
        "base": {"rotation_vector": [0.0, 0.0, 0.5 * pi], "position": [0.0, 0.0, 1.0]},
        "tool": {"rotation_vector": [0.0, 0.5 * pi, 0.0]},
    }
}


def test_a_named_frame_is_fixed_to_the_device_and_has_its_own_tool():
    session = Session(frames=FRAMES)
    session.now(lambda: session.base(as_user(exp((0.3, 0.0, 0.0)))))
    session.now(lambda: session.look_at([2.0, 0.0, -1.0], frame="mast"))
    session.run(4.0)
    # Frame: x is the device's y, one metre up.  The tool's x axis is the flange's -z.
    found = axis_of(session.world.guard.q, (0.0, 0.0, -1.0))
    assert found == pytest.approx((0.0, 1.0, 0.0), abs=1e-6)


def test_an_orientation_in_the_world_is_kept_on_a_moving_base():
    session, base, held = Session(), swung(0.5, LIMITS), exp((0.2, 0.3, -0.1))
    session.stream(
        SECONDS,
        lambda t, s: session.base(as_user(base(t)), angular_velocity=rate_of(base, t), time_ns=s),
    )
    session.now(lambda: session.aim_in_world(as_user(held)))
    assert largest(session, lambda q, t: angle(multiply(base(t), q), held)) < 3e-3


def test_a_stale_base_ends_the_targets_and_is_an_error_with_its_time():
    session, base = Session(), swung(0.5, LIMITS)
    session.now(lambda: session.look_at([9.0, 1.0, 0.0]))
    session.stream(
        1.5,
        lambda t, s: session.base(as_user(base(t)), angular_velocity=rate_of(base, t), time_ns=s),
    )
    session.run(1.4)
    assert not session.now(lambda: session.base_report).is_stale
    assert not session.world.tracker.is_at_rest
    session.run(1.0)
    report = session.now(lambda: session.base_report)
    assert report.is_stale
    assert report.stale_since_ns == report.time_ns + NS // 5
    assert session.world.tracker.is_at_rest
    with pytest.raises(StaleBaseError, match=r"the base is stale for 0\.\d+ s") as caught:
        session.now(lambda: session.look_at([9.0, 2.0, 0.0]))
    assert caught.value.since_ns == report.stale_since_ns


def test_the_device_points_again_once_the_base_is_back():
    session = Session()
    line = (0.0, 1.0, 0.0)
    session.now(lambda: session.base(as_user(IDENTITY)))
    session.run(1.0)
    with pytest.raises(StaleBaseError):
        session.now(lambda: session.look_at([0.0, 4.0, 0.0]))
    session.stream(4.0, lambda t, s: session.base(as_user(exp((0.0, 0.0, 0.1))), time_ns=s))
    session.run(4.0)
    assert off_line(multiply(exp((0.0, 0.0, 0.1)), session.world.guard.q), line) < 1e-5


def test_samples_of_the_base_that_are_none_are_skipped_and_counted():
    session = Session()
    session.run(10.0)
    nan = Quaternion(w=float("nan"), x=0.0, y=0.0, z=0.0)
    old, new = session.now_ns - NS, session.now_ns
    session.now(lambda: session.base(nan))
    session.now(lambda: session.base(Quaternion(w=2.0, x=0.0, y=0.0, z=0.0)))
    session.now(lambda: session.base(as_user(IDENTITY), time_ns=old))
    assert session.now(lambda: session.base_report)[:2] == (0, 3)
    session.now(lambda: session.base(as_user(IDENTITY), time_ns=new))
    session.now(lambda: session.base(as_user(IDENTITY), time_ns=new - 1))
    report = session.now(lambda: session.base_report)
    assert report[:2] == (1, 4)


@pytest.mark.parametrize(
    "call",
    [
        lambda s: s.look_at([1.0, 2.0]),
        lambda s: s.look_at([0.0, 0.0, 0.0]),
        lambda s: s.look_at([1.0, 0.0, float("nan")]),
        lambda s: s.look_at([1.0, 0.0, 0.0], roll="most"),
        lambda s: s.look_at([1.0, 0.0, 0.0], pointing_axis="w"),
        lambda s: s.look_at([1.0, 0.0, 0.0], time_to_live=0.0),
        lambda s: s.point(float("inf"), 0.0),
        lambda s: s.point(0.0, -2443.5),
        lambda s: s.base(as_user(IDENTITY), velocity_frame="sea"),
        lambda s: s.base(as_user(IDENTITY), time_ns=s.now_ns + 2 * NS),
        lambda s: s.aim_in_world("up"),
    ],
)
def test_malformed_arguments_are_refused_and_change_nothing(call):
    session = Session()
    with pytest.raises(RequestError):
        session.now(lambda: call(session))
    assert session.sent == []


def test_a_base_that_is_stamped_ahead_of_the_clock_is_refused_and_blinds_nothing():
    session = Session()
    session.now(lambda: session.base(as_user(IDENTITY), time_ns=session.now_ns))
    ahead = session.now_ns + 900_000_000
    with pytest.raises(RequestError, match=r"time_ns: expected at most 0.05 s ahead, got 0.9 s; "):
        session.now(lambda: session.base(as_user(IDENTITY), time_ns=ahead))
    session.run(0.02)
    session.now(lambda: session.base(as_user(IDENTITY), time_ns=session.now_ns))
    assert session.now(lambda: session.base_report)[:2] == (2, 0)


def refused(session, call):
    """Return the problems of a stream of samples for 3 s, each with its time, s."""
    start_ns, problems = session.now_ns, []

    def sample(t, stamp_ns):
        try:
            call(t, stamp_ns)
        except RequestError as error:
            problems.append(((session.now_ns - start_ns) / NS, str(error)))

    session.stream(3.0, sample)
    session.run(3.0)
    return problems


@pytest.mark.parametrize(
    ("wrong", "times"), [(180.0 / pi, "57.3"), (pi / 180.0, "0.0175"), (1.5, ""), (-57.3, "")]
)
def test_rates_of_a_base_in_degrees_are_refused_by_name(wrong, times):
    session, base = Session(), swung(0.3, LIMITS)

    def call(t, stamp_ns):
        omega = tuple(wrong * x for x in rate_of(base, t))
        session.base(as_user(base(t)), angular_velocity=omega, time_ns=stamp_ns)

    session.now(lambda: session.look_at([30.0, 10.0, 5.0]))
    problems = refused(session, call)
    assert bool(problems) is bool(times)
    if times:
        began, problem = problems[0]
        assert began < 1.0
        assert problem.startswith(f"angular_velocity: expected rad/s, got {times} times the change")
        assert session.now(lambda: session.base_report).is_stale


def test_rates_of_a_direction_in_radians_are_refused_by_name():
    session = Session()

    def call(t, stamp_ns):
        turn = 40.0 * sin(t)
        rate = 40.0 * cos(t) * pi / 180.0
        session.point(turn, 10.0, azimuth_rate=rate, time_ns=stamp_ns)

    problems = refused(session, call)
    assert "azimuth_rate, elevation_rate: expected degrees/s, got 0.017" in problems[0][1]


def test_a_noisy_base_at_rest_is_never_taken_for_one_in_degrees():
    session, random = Session(), Random(1)

    def call(t, stamp_ns):
        shake = [random.gauss(0.0, 1e-3) for _ in range(6)]
        session.base(as_user(exp(shake[:3])), angular_velocity=shake[3:], time_ns=stamp_ns)

    assert refused(session, call) == []


def test_a_base_that_is_sampled_faster_than_targets_are_useful_is_thinned_out():
    session = Session()
    session.now(lambda: session.look_at([1.0, 0.0, 0.0]))
    session.stream(1.0, lambda t, s: session.base(as_user(IDENTITY), time_ns=s), fps=1000)
    session.run(1.1)
    assert 150 < len(session.sent) < 300


def test_a_gimbal_of_two_axes_points_there_whatever_the_roll():
    axes = [AxisLimits("pan", -10.0, 10.0, 9.0), AxisLimits("tilt", -10.0, 10.0, 9.0)]
    gimbal = Gimbal(axes, order="ZY", is_pointing=True)
    session, line = Session(), (0.48, 0.64, 0.6)
    session.now(lambda: session.look_at([4.8, 6.4, 6.0], roll=70.0))
    session.run(3.0)
    joints = gimbal.nearest(session.world.guard.q, ZERO, (0.0, 0.0))
    assert off_line(gimbal.orientation(joints), line) < 1e-6
