"""Whole-path planning: keyholes, branches, turns, stops, and what is refused."""

import math

import numpy as np
import pytest
from reference.gimbal import damped_rates, jacobian

from orientd.errors import LimitError, PlanError, StartError
from orientd.rotation import angle, exp, from_axis_angle, from_matrix, log, multiply
from orientd_dynamixel.certificate import AxisLimits, DeviationPolicy, ToolLimits, rates
from orientd_dynamixel.kinematics import Gimbal
from orientd_dynamixel.path import plan_axes
from orientd_dynamixel.tracker import AxisTracker

PERIOD = 0.005
NO_LOAD = 4.817


def passing(miss_deg, rate_deg=15.0, half=4.0):
    """A tool axis on a great circle that misses the pole by an angle."""
    miss = np.deg2rad(miss_deg)
    times = np.arange(-half, half + PERIOD / 2, PERIOD)
    nearest = np.array([0.0, np.sin(miss), np.cos(miss)])
    normal = np.cross(nearest, [1.0, 0, 0])
    frame = np.stack([nearest, normal, np.cross(nearest, normal)], axis=1)
    turn = from_axis_angle(normal, np.deg2rad(rate_deg) * times)
    return multiply(turn, from_matrix(frame))


def limits(order, velocity=3.85, acceleration=40.0, turns=(270, 200, 200)):
    return [
        AxisLimits(-np.deg2rad(most), np.deg2rad(most), velocity, acceleration, name)
        for most, name in zip(turns, ("pan", "tilt", "roll"), strict=True)
    ][: len(order)]


def damped_passing(q, epsilon=0.12, gain=10.0):
    """What damped least squares makes of the same path: error and peak rate."""
    gimbal = Gimbal("ZYX")
    angles = gimbal.inverse(q[0])[0].copy()
    worst = fastest = 0.0
    for k in range(1, len(q)):
        forward = log(multiply(q[k], q[k - 1] * [1, -1, -1, -1])) / PERIOD
        error = log(multiply(q[k - 1], gimbal.forward(angles) * [1, -1, -1, -1]))
        rate = damped_rates(jacobian(gimbal, angles), forward + gain * error, epsilon=epsilon,
                            damping=epsilon)  # fmt: skip
        rate *= min(1.0, NO_LOAD / np.max(np.abs(rate)))
        angles += rate * PERIOD
        fastest = max(fastest, float(np.max(np.abs(rate))))
        worst = max(worst, float(angle(gimbal.forward(angles), q[k])))
    return np.rad2deg(worst), fastest


# Measured once with damped least squares at epsilon = 0.12: (miss deg, peak rad/s, error deg).
DAMPED = [(0.1, 0.26, 0.15), (0.5, 0.40, 0.77), (2.0, 1.77, 3.35), (5.0, 2.95, 3.54),
          (10.0, 1.51, 0.01)]  # fmt: skip


@pytest.mark.parametrize(
    ("miss", "rate", "error"),
    [pytest.param(*one, marks=() if one[0] in (0.5, 5.0) else pytest.mark.slow) for one in DAMPED],
)
def test_damped_least_squares_is_reproduced(miss, rate, error):
    got_error, got_rate = damped_passing(passing(miss, half=2.0))
    assert got_rate == pytest.approx(rate, rel=0.15)
    assert got_error == pytest.approx(error, rel=0.25, abs=0.05)


@pytest.mark.parametrize("order", ["ZY", "ZYX"])
@pytest.mark.parametrize(("miss", "rate", "error"), DAMPED)
def test_planned_passage_beats_damped_least_squares(order, miss, rate, error):
    is_planning_better = miss in {2.0, 5.0}
    asked = 0.95 * rate if is_planning_better else max(rate, 0.265)
    path = plan_axes(
        Gimbal(order), passing(miss), PERIOD, limits(order, asked),
        policy=DeviationPolicy(max_deviation=np.deg2rad(4)),
    )  # fmt: skip
    got = path.certificate
    fastest = max(peak.value for peak in got.velocity)
    assert round(fastest, 2) <= rate
    assert np.rad2deg(got.error.value) <= error
    if is_planning_better:
        assert fastest < 0.96 * rate
        assert np.rad2deg(got.error.value) < 0.6 * error


@pytest.mark.parametrize("order", ["ZY", "ZYX", "ZXY", "ZYZ"])
def test_exact_path_stays_exact(order):
    times = np.arange(0, 5, PERIOD)
    q = exp(np.stack([0.3 * np.sin(times), 0.4 * np.sin(1.3 * times), 0.5 * np.sin(times)], axis=1))
    q = multiply(from_axis_angle([0, 1, 0], 0.6), q)
    path = plan_axes(Gimbal(order), q, PERIOD, limits(order))
    assert path.certificate.error.value < 1e-12
    assert not path.certificate.slews
    if len(order) == 3:
        assert np.max(angle(path.q, q)) < 1e-12


def test_certificate_states_what_the_samples_show():
    path = plan_axes(Gimbal("ZYX"), passing(10), PERIOD, limits("ZYX"))
    velocity, acceleration = rates(path.angles, PERIOD)
    for axis in range(3):
        assert path.certificate.velocity[axis].value == np.max(np.abs(velocity[:, axis]))
        assert path.certificate.acceleration[axis].value == np.max(np.abs(acceleration[:, axis]))
        at = int(np.argmax(np.abs(velocity[:, axis])))
        assert path.certificate.velocity[axis].time == pytest.approx(at * PERIOD)
    assert path.certificate.velocity[0].value == pytest.approx(
        0.2618 / np.sin(np.deg2rad(10)), 1e-3
    )
    expected = np.sqrt(1 - np.cos(np.deg2rad(10)))
    assert path.certificate.manipulability == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("order", ["ZY", "ZYX"])
def test_path_through_the_pole_itself_goes_straight_over(order):
    path = plan_axes(Gimbal(order), passing(0.0), PERIOD, limits(order))
    assert path.certificate.error.value < 1e-12
    assert path.certificate.velocity[0].value < 1e-9
    assert np.ptp(path.angles[:, 1]) == pytest.approx(np.deg2rad(120), rel=1e-6)


def test_tilt_that_cannot_pass_the_zenith_flips_by_a_deviation_or_is_refused():
    narrow = [limits("ZY")[0], AxisLimits(-np.deg2rad(95), 0.2, 3.85, 40, "tilt")]
    with pytest.raises(LimitError, match="velocity of pan"):
        plan_axes(Gimbal("ZY"), passing(3), PERIOD, narrow)
    path = plan_axes(
        Gimbal("ZY"),
        passing(3),
        PERIOD,
        narrow,
        policy=DeviationPolicy(max_deviation=np.deg2rad(3)),
    )
    assert [hole.kind for hole in path.certificate.keyholes] == ["flip"]
    assert path.certificate.error.value <= np.deg2rad(3)
    assert np.min(path.angles[:, 1]) >= -np.deg2rad(95)


def test_deviation_is_certified_by_what_the_axes_make():
    q = passing(2)
    path = plan_axes(
        Gimbal("ZYX"), q, PERIOD, limits("ZYX"), policy=DeviationPolicy(max_deviation=np.deg2rad(4))
    )
    assert path.certificate.error.value == pytest.approx(float(np.max(angle(path.q, q))), rel=1e-9)
    hole = path.certificate.keyholes[0]
    outside = np.r_[0 : round(hole.start / PERIOD), round(hole.end / PERIOD) + 1 : len(q)]
    assert np.max(angle(path.q[outside], q[outside])) < 1e-9


def test_refusal_names_axis_value_limit_and_time():
    with pytest.raises(LimitError, match="velocity of pan reaches") as caught:
        plan_axes(Gimbal("ZYX"), passing(2), PERIOD, limits("ZYX"))
    assert caught.value.limit == 3.85
    assert caught.value.value > 3.85
    assert caught.value.time == pytest.approx(4.0, abs=0.5)


def test_angle_outside_every_branch_is_refused_with_its_time():
    q = from_axis_angle([0, 0, 1], np.linspace(0, np.pi, 400))
    narrow = [AxisLimits(-1, 1, name="pan"), AxisLimits(-1, 1, name="tilt"), *limits("ZYX")[2:]]
    with pytest.raises(LimitError, match="angle of pan") as caught:
        plan_axes(Gimbal("ZYX"), q, PERIOD, narrow)
    assert caught.value.time == pytest.approx(1 / np.pi * 399 * PERIOD, abs=0.01)


def test_axis_that_has_wound_up_is_refused_for_its_angle_not_for_a_jump():
    q = from_axis_angle([0, 0, 1], np.deg2rad(np.linspace(0, 300, 2000)))
    with pytest.raises(LimitError, match=r"angle of pan reaches .*begin on another turn") as caught:
        plan_axes(Gimbal("ZYX"), q, PERIOD, limits("ZYX"), start=[0.0, 0.0, 0.0])
    assert np.rad2deg(caught.value.value) == pytest.approx(270, abs=0.2)
    assert caught.value.limit == pytest.approx(np.deg2rad(270))
    assert caught.value.time == pytest.approx(0.9 * 2000 * PERIOD, abs=2 * PERIOD)


def test_winding_is_chosen_for_the_whole_path():
    """A turn of 400 degrees fits +-270 only when it begins at the far end."""
    q = from_axis_angle([0, 0, 1], np.deg2rad(np.linspace(0, 400, 2000)))
    with pytest.raises(LimitError):
        plan_axes(Gimbal("ZY"), q, PERIOD, limits("ZY"), start=[0.0, 0.0])
    q = multiply(from_axis_angle([0, 0, 1], np.deg2rad(-200)), q)
    path = plan_axes(Gimbal("ZY"), q, PERIOD, limits("ZY"))
    assert path.certificate.travel[0] == pytest.approx(np.deg2rad((-200, 200)))


def test_second_branch_is_taken_where_it_alone_has_the_way():
    # Pan can do -30..270 only: looking to -170 means +10 with the tilt over the top.
    only = [
        AxisLimits(np.deg2rad(-30), np.deg2rad(100), name="pan"),
        AxisLimits(-4, 4, name="tilt"),
    ]
    q = from_axis_angle([0, 0, 1], np.deg2rad(np.linspace(-170, -90, 800)))
    path = plan_axes(Gimbal("ZY"), q, PERIOD, only)
    assert np.rad2deg(path.angles[0]) == pytest.approx([10, 180], abs=1e-6) or np.rad2deg(
        path.angles[0]
    ) == pytest.approx([10, -180], abs=1e-6)


def test_path_that_does_not_begin_at_the_gimbal_is_refused():
    q = from_axis_angle([0, 0, 1], np.linspace(0, 1, 400))
    with pytest.raises(StartError, match="does not begin"):
        plan_axes(Gimbal("ZYX"), q, PERIOD, limits("ZYX"), start=[0.5, 0, 0])


def test_forced_unwinding_is_a_stop_with_continuous_rates():
    times = np.arange(0, 8, PERIOD)
    pan = np.deg2rad(500) * (times / 8 - np.sin(2 * np.pi * times / 8) / (2 * np.pi))
    q = from_axis_angle([0, 0, 1], pan)
    bounds = limits("ZY", velocity=3.0, acceleration=20.0)
    path = plan_axes(
        Gimbal("ZY"), q, PERIOD, bounds, start=[0.0, 0.0], policy=DeviationPolicy(allow_slews=True)
    )
    (slew,) = path.certificate.slews
    assert (
        abs(slew.after[0] - slew.before[0]) == pytest.approx(2 * np.pi, abs=0.02)
        or abs(slew.after[1] - slew.before[1]) > 3
    )
    velocity, acceleration = rates(path.angles, PERIOD)
    assert np.max(np.abs(velocity)) <= 3.0 * (1 + 1e-9)
    assert np.max(np.abs(acceleration[3:])) <= 20.0 * 1.05
    at = round(slew.start / PERIOD)
    assert np.max(np.abs(velocity[at - 1 : at + 3])) < 0.05
    assert path.certificate.travel[0][1] <= np.deg2rad(270) + 1e-9


def walked(steps, start=(1.0, 0.0, 0.0, 0.0)):
    """The orientations that many turns lead to one after the other, in plain floats."""
    way = [tuple(map(float, start))]
    for w, x, y, z in steps.tolist():
        a, b, c, d = way[-1]
        q = (
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        )
        norm = math.hypot(*q)
        way.append(tuple(part / norm for part in q))
    return np.array(way)


@pytest.mark.parametrize("order", ["ZYX", "ZXY"])
def test_random_walk_never_jumps_unplanned(order):
    rng = np.random.default_rng(10)
    q = walked(exp(rng.normal(scale=np.deg2rad(0.35), size=(20_000, 3))))
    bounds = limits(order, velocity=NO_LOAD, acceleration=np.inf)
    path = plan_axes(Gimbal(order), q, PERIOD, bounds, start=[0, 0, 0],
                     policy=DeviationPolicy(allow_slews=True))  # fmt: skip
    velocity, _ = rates(path.angles, PERIOD)
    assert np.max(np.abs(velocity)) <= NO_LOAD * (1 + 1e-6)
    for axis, most in enumerate((270, 200, 200)):
        low, high = path.certificate.travel[axis]
        assert np.rad2deg(high) <= most + 1e-6
        assert np.rad2deg(low) >= -most - 1e-6
    # Every sample asked for is reached, exactly, outside the slews.
    assert path.certificate.error.value < 1e-9


def test_random_walk_without_slews_is_refused_or_within_limits():
    rng = np.random.default_rng(11)
    q = walked(exp(rng.normal(scale=np.deg2rad(0.35), size=(20_000, 3))))
    with pytest.raises(LimitError):
        plan_axes(Gimbal("ZYX"), q, PERIOD, limits("ZYX", NO_LOAD, np.inf), start=[0, 0, 0])


@pytest.mark.parametrize(("order", "seed"), [("ZYX", 1), ("ZXY", 2)])
def test_walk_that_winds_up_is_unwound_by_planned_slews_only(order, seed):
    """20,000 samples of a walk with memory, which runs into the cable limits again and again."""
    rng = np.random.default_rng(seed)
    omega = np.zeros((20_001, 3))
    for k in range(20_000):
        omega[k + 1] = 0.995 * omega[k] + rng.normal(scale=0.06, size=3)
    q = walked(exp(omega[1:] * PERIOD))
    bounds = limits(order, velocity=NO_LOAD, acceleration=np.inf)
    path = plan_axes(Gimbal(order), q, PERIOD, bounds, start=[0, 0, 0],
                     policy=DeviationPolicy(allow_slews=True))  # fmt: skip
    naive = np.abs(np.diff(Gimbal(order).inverse(q)[:, 0], axis=0))
    assert np.sum(np.max(naive, axis=1) > np.pi / 2) >= 10
    velocity, _ = rates(path.angles, PERIOD)
    assert np.max(np.abs(velocity)) <= NO_LOAD * 1.001
    left = [slew for slew in path.certificate.slews if not slew.is_on_path]
    assert 1 <= len(left) <= 14
    for slew in left:
        first, last = round(slew.start / PERIOD), round(slew.end / PERIOD)
        assert path.angles[first] == pytest.approx(slew.before, abs=1e-9)
        assert path.angles[last] == pytest.approx(slew.after, abs=1e-9)
    assert path.certificate.error.value < 1e-9
    for (low, high), limit in zip(path.certificate.travel, bounds, strict=True):
        assert limit.low - 1e-6 <= low <= high <= limit.high + 1e-6


def wandering(seed, length=6.0):
    """A smooth random path from rest to rest."""
    rng = np.random.default_rng(seed)
    times = np.arange(0, length, PERIOD)
    omega = sum(
        rng.normal(size=3) * np.sin(f * 0.7 * times + rng.uniform(0, 6))[:, None] for f in (1, 2, 3)
    )
    omega *= rng.uniform(0.3, 1.2) * np.sin(np.pi * times / length)[:, None] ** 2
    start = rng.normal(size=4)
    return walked(exp(omega[1:] * PERIOD), start / np.linalg.norm(start))


POLICIES = [
    DeviationPolicy(),
    DeviationPolicy(max_deviation=np.deg2rad(3)),
    DeviationPolicy(allow_slews=True),
    DeviationPolicy(max_deviation=np.deg2rad(3), allow_slews=True),
]


@pytest.mark.parametrize("order", ["ZYX", "ZXY", "ZYZ", "ZY"])
@pytest.mark.parametrize("number", range(len(POLICIES)))
def test_any_path_is_inside_its_limits_or_refused(order, number):
    policy, bounds, planned = POLICIES[number], limits(order), 0
    for seed in range(3):
        q = wandering(10 * number + seed)
        try:
            path = plan_axes(Gimbal(order), q, PERIOD, bounds, policy=policy)
        except LimitError:
            continue
        planned += 1
        got = path.certificate
        velocity, acceleration = rates(path.angles, path.times[1] - path.times[0])
        for axis, limit in enumerate(bounds):
            assert np.max(np.abs(velocity[:, axis])) <= limit.velocity * 1.001
            assert np.max(np.abs(acceleration[:, axis])) <= limit.acceleration * 1.001
            assert got.travel[axis][0] >= limit.low - 1e-6
            assert got.travel[axis][1] <= limit.high + 1e-6
        assert got.error.value <= policy.max_deviation * (1 + 1e-6) + 1e-9
        if not got.slews and len(order) == 3:
            assert np.max(angle(path.q, q)) <= policy.max_deviation * (1 + 1e-6) + 1e-9
    assert planned > 0


def test_stretch_that_is_too_fast_is_gone_along_slowly_on_the_path():
    q = passing(2)
    path = plan_axes(
        Gimbal("ZYX"), q, PERIOD, limits("ZYX"), policy=DeviationPolicy(allow_slews=True)
    )
    (crawl,) = path.certificate.slews
    assert crawl.is_on_path
    # Every orientation on the way is one of the path's.
    inside = (path.times >= crawl.start) & (path.times <= crawl.end)
    near = np.max(np.abs(path.q[inside] @ q[700:900].T), axis=1)
    assert 2 * np.arccos(np.min(near).clip(-1, 1)) < np.deg2rad(15) * PERIOD


def leaving_the_pole(order, away, *, seconds=2.0, hold=0):
    """A path from rest at the pole, and where the gimbal stands: *away* from its direction."""
    times = np.arange(0, seconds, PERIOD) / seconds
    way = 1.2 * (10 * times**3 - 15 * times**4 + 6 * times**5)
    way = np.concatenate([np.zeros(hold), way])
    gimbal = Gimbal(order)
    start = np.array([0.4, -np.pi / 2 if order != "ZXY" else np.pi / 2, 0.3])[: len(order)]
    q = gimbal.forward(start)
    turned = start.copy()
    turned[0] += away
    if len(order) == 3:
        # The same orientation: what the outer axis is turned, the inner one is turned back.
        signs = (1, -1)
        turned = min(
            (np.add(turned, (0, 0, sign * away)) for sign in signs),
            key=lambda angles: float(angle(gimbal.forward(angles), q)),
        )
        assert angle(gimbal.forward(turned), q) < 1e-9
    outer = from_axis_angle([0, 0, 1], start[0])
    axis = multiply(
        multiply(outer, [0, *np.eye(3)["XYZ".index(order[1])]]), outer * [1, -1, -1, -1]
    )
    return multiply(from_axis_angle(axis[1:], way), q), turned


@pytest.mark.parametrize("order", ["ZYX", "ZXY", "ZY"])
@pytest.mark.parametrize("away", [0.3, -1.2, 1.5])
@pytest.mark.parametrize("hold", [0, 100])
def test_path_that_leaves_the_pole_elsewhere_is_refused_for_what_it_is(order, away, hold):
    q, start = leaving_the_pole(order, away, hold=hold)
    with pytest.raises(PlanError, match=f"{np.rad2deg(abs(away)):.1f} deg away from where pan is"):
        plan_axes(Gimbal(order), q, PERIOD, limits(order), start=start)


@pytest.mark.parametrize("order", ["ZYX", "ZXY", "ZY"])
@pytest.mark.parametrize("away", [0.3, -1.2, 1.5])
@pytest.mark.parametrize("hold", [0, 100])
def test_slew_at_the_pole_is_one_that_the_driver_follows(order, away, hold):
    q, start = leaving_the_pole(order, away, hold=hold)
    tool = ToolLimits(1.5, 8.0, 1500.0)
    bounds = limits(order)
    path = plan_axes(Gimbal(order), q, PERIOD, bounds, start=start,
                     policy=DeviationPolicy(allow_slews=True), tool=tool)  # fmt: skip
    (slew,) = path.certificate.slews
    assert not slew.is_on_path
    assert path.angles[0] == pytest.approx(start, abs=1e-9)
    tracker = AxisTracker(order, (1.0, 0, 0, 0), (1.0, 0, 0, 0), is_pointing=True)
    tracker.angles = tuple(start.tolist())
    worst = 0.0
    for wanted, row in zip(path.q.tolist(), path.angles, strict=True):
        tracker.angles, _ = tracker.solve(wanted)
        worst = max(worst, float(np.max(np.abs(np.subtract(tracker.angles, row)))))
    assert worst < 1e-4
    velocity, acceleration = rates(path.angles, PERIOD)
    for axis, limit in enumerate(bounds):
        assert np.max(np.abs(velocity[:, axis])) <= limit.velocity * 1.001
        assert np.max(np.abs(acceleration[:, axis])) <= limit.acceleration * 1.001
    if len(order) == 3:
        assert angle(path.q[-1], q[-1]) < 1e-9
    assert path.certificate.error.value < 1e-6


@pytest.mark.parametrize("order", ["ZYX", "ZXY"])
def test_turn_at_the_pole_is_one_of_the_outer_axis_as_in_the_driver(order):
    q, start = leaving_the_pole(order, 0.3)
    times = np.linspace(0, 1, 400)
    spin = 0.8 * (10 * times**3 - 15 * times**4 + 6 * times**5)
    q = multiply(from_axis_angle([0, 0, 1], spin), q[0])
    path = plan_axes(Gimbal(order), q, PERIOD, limits(order), start=start)
    assert path.angles[-1] == pytest.approx(np.add(start, (0.8, 0, 0)), abs=1e-9)
    tracker = AxisTracker(order, (1.0, 0, 0, 0), (1.0, 0, 0, 0))
    tracker.angles = tuple(start.tolist())
    for wanted in path.q.tolist():
        tracker.angles, _ = tracker.solve(wanted)
    assert tracker.angles == pytest.approx(path.angles[-1], abs=1e-6)


def test_path_that_leaves_the_pole_as_the_gimbal_stands_needs_nothing():
    for order in ("ZYX", "ZY"):
        q, start = leaving_the_pole(order, 0.0)
        path = plan_axes(Gimbal(order), q, PERIOD, limits(order), start=start)
        assert path.certificate.error.value < 1e-9
        assert path.angles[0] == pytest.approx(start, abs=1e-12)
