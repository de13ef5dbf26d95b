import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig, peaks
from scipy.spatial.transform import Rotation

from orientd.driver import ZERO, AxisLimits
from orientd.floats import exp, multiply
from orientd.servo.guard import Guard
from orientd.servo.tracking.target_follower import TargetFollower
from orientd.stream.records import LIMIT_FLOATS, ServoLimits

Q = (1.0, 0.0, 0.0, 0.0)


def stop_off_path(guard, servo_limits):
    """Yield the setpoints of a stop from what the guard has taken, without path or targets."""
    rig = Rig()
    follower = TargetFollower(rig.memory.targets, rig.memory.chunks, guard)
    follower.begin(servo_limits)
    while not (follower.tracker.is_at_rest and guard.velocity == ZERO):
        point, position, _ = follower.step(0, servo_limits, is_stopping=True)
        guard.take(point.q, position)
        yield point.q, position


def turning(guard, alpha, cycles):
    """Accelerate about a fixed axis; return what was admitted."""
    sent, omega = [guard.q], np.zeros(3)
    push = np.zeros(3)
    for _ in range(cycles):
        push = push + np.clip(np.asarray(alpha) - push, -8.0, 8.0)
        omega = omega + push * PERIOD
        q = multiply(sent[-1], exp(tuple(omega * PERIOD)))
        assert guard.admit(q, ZERO, TERMS) == ""
        sent.append(q)
    return sent


@pytest.mark.parametrize(
    ("alpha", "cycles"), [((4.0, 0, 0), 100), ((9.0, -9.0, 3.0), 60), ((0, 0, 16.9), 30)]
)
def test_a_soft_stop_keeps_every_limit_and_ends_at_rest(alpha, cycles):
    guard = Guard(PERIOD)
    sent = turning(guard, alpha, cycles)
    sent += [q for q, _ in stop_off_path(guard, TERMS)]
    velocity, acceleration, jerk = peaks(np.array(sent))
    assert velocity <= TERMS.velocity * 1.001
    assert acceleration <= TERMS.acceleration * 1.001
    assert jerk <= TERMS.jerk * 1.001
    np.testing.assert_allclose(sent[-1], guard.q)


@pytest.mark.parametrize(
    ("step", "quantity"),
    [
        (0.0051, "angular velocity"),
        (0.0000681, "angular acceleration"),
    ],
)
def test_a_violation_names_the_quantity_and_changes_nothing(step, quantity):
    guard = Guard(PERIOD)
    before = (guard.q, guard.omega, guard.alpha)
    problem = guard.admit(exp((step, 0.0, 0.0)), ZERO, TERMS)
    assert problem.startswith(quantity)
    assert "the limit is" in problem
    assert (guard.q, guard.omega, guard.alpha) == before


def test_a_step_within_velocity_and_acceleration_can_still_break_the_jerk():
    guard = Guard(PERIOD)
    assert guard.admit(exp((6.79e-5, 0.0, 0.0)), ZERO, TERMS) == ""  # 16.98 rad/s^2, 8488 rad/s^3
    problem = guard.admit(guard.q, ZERO, TERMS)  # back to rest: twice the step
    assert problem.startswith("angular jerk")


def test_a_sign_flip_is_the_same_orientation():
    guard = Guard(PERIOD)
    guard.anchor(exp((0.3, 0.2, 0.1)), ZERO)
    flipped = tuple(-part for part in guard.q)
    assert guard.admit(flipped, ZERO, TERMS) == ""
    assert np.linalg.norm(guard.omega) < 1e-12


ABOUT_Z = replace(TERMS, axis_velocity=(2.0, 1.0, 0.5), axis_acceleration=(9.0, 9.0, 4.0))


def test_a_component_beyond_its_own_limit_is_named_with_its_axis():
    guard = Guard(PERIOD)
    q = exp((0.0, 0.0, 4.1 * PERIOD**2))
    assert Guard(PERIOD).admit(q, ZERO, TERMS) == ""
    problem = guard.admit(q, ZERO, ABOUT_Z)
    assert problem == "angular acceleration 4.1 rad/s^2 about z, the limit is 4 rad/s^2"
    assert guard.q == Q
    assert guard.admit(exp((0.0, 0.0, 3.9 * PERIOD**2)), ZERO, ABOUT_Z) == ""


def test_a_component_that_is_not_a_number_is_not_admitted():
    guard = Guard(PERIOD)
    servo_limits = replace(TERMS, axis_jerk=(math.nan, 1e9, 1e9))
    assert servo_limits.has_axes
    assert "about x" in guard.admit(exp((1e-6, 0.0, 0.0)), ZERO, servo_limits)


@pytest.mark.parametrize("alpha", [(1.0, -2.0, 3.9), (8.0, 3.0, 0.0), (-0.3, 0.0, -3.9)])
def test_a_soft_stop_keeps_the_limits_of_every_axis(alpha):
    servo_limits = replace(ABOUT_Z, axis_jerk=(8000.0, 8000.0, 120.0))
    guard = Guard(PERIOD)
    sent = turning(guard, alpha, 40)
    sent += [q for q, _ in stop_off_path(guard, servo_limits)]
    quaternions = Rotation.from_quat(np.array(sent)[:, [1, 2, 3, 0]])
    omega = (quaternions[:-1].inv() * quaternions[1:]).as_rotvec() / PERIOD
    omega = np.concatenate([omega, np.zeros((3, 3))])
    stop = omega[40:]
    alphas = np.diff(stop, axis=0) / PERIOD
    jerk = np.diff(alphas, axis=0) / PERIOD
    assert np.all(np.abs(stop).max(axis=0) <= np.array(servo_limits.axis_velocity) * 1.001)
    assert np.all(np.abs(alphas).max(axis=0) <= np.array(servo_limits.axis_acceleration) * 1.001)
    assert np.all(np.abs(jerk).max(axis=0) <= np.array(servo_limits.axis_jerk) * 1.001)


@pytest.mark.parametrize("seed", range(20))
def test_a_soft_stop_keeps_the_limits_of_every_axis_from_any_motion(seed):
    random = np.random.default_rng(seed)
    axes = [random.uniform(0.2, 1.0, 3) * most for most in (2.0, 9.0, 400.0)]
    velocity, acceleration, jerk = (tuple(axis.tolist()) for axis in axes)
    servo_limits = replace(
        TERMS, axis_velocity=velocity, axis_acceleration=acceleration, axis_jerk=jerk
    )
    guard = Guard(PERIOD)
    guard.omega = tuple((random.uniform(-0.5, 0.5, 3) * axes[0]).tolist())
    guard.alpha = tuple((random.uniform(-0.9, 0.9, 3) * axes[1]).tolist())
    before = np.array(guard.alpha)
    alphas = [guard.alpha for _ in stop_off_path(guard, servo_limits)]
    assert np.abs(guard.omega).max() < 1e-9
    jerks = np.diff(np.vstack([before, alphas]), axis=0) / PERIOD
    assert np.all(np.abs(alphas) <= axes[1] * 1.001)
    assert np.all(np.abs(jerks) <= axes[2] * 1.001)


QUANTITIES = ["velocity", "acceleration", "jerk"]
UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3"}
WIDE = ServoLimits(1e3, 1e6, 1e9, 1.0, 10.0, 4.0)


def reaching(quantity, vector):
    """Return a guard and an orientation that gives *quantity* that value and others small ones."""
    guard = Guard(PERIOD)
    order = QUANTITIES.index(quantity)
    rates = [np.zeros(3)] * 3
    rates[order] = np.array(vector)
    omega, alpha, jerk = rates
    # What was before differs by just what the derivatives from there on are.
    alpha = alpha + 0.5 * jerk * PERIOD
    omega = omega - 0.5 * alpha * PERIOD
    guard.alpha = tuple((alpha - jerk * PERIOD).tolist())
    guard.omega = tuple((omega - alpha * PERIOD).tolist())
    return guard, exp(tuple((omega * PERIOD).tolist()))


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_limit_may_be_exceeded_by_a_thousandth_and_no_more(quantity, direction):
    limit = {"velocity": 2.0, "acceleration": 16.0, "jerk": 9000.0}[quantity]
    servo_limits = replace(WIDE, **{quantity: limit})
    for share, is_admitted in ((1.0009, True), (1.0011, False)):
        guard, q = reaching(quantity, np.array(direction) * limit * share)
        problem = guard.admit(q, ZERO, servo_limits)
        assert (problem == "") is is_admitted
    unit = UNITS[quantity]
    said = f"angular {quantity} {limit * 1.0011:.6g} {unit}, the limit is {limit:.6g} {unit}"
    assert problem == said


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_component_may_exceed_its_limit_by_a_thousandth_and_no_more(quantity, axis):
    limit = {"velocity": 2.0, "acceleration": 16.0, "jerk": 9000.0}[quantity]
    axes = [5.0 * limit] * 3
    axes[axis] = limit
    servo_limits = replace(WIDE, **{f"axis_{quantity}": tuple(axes)})
    for share, is_admitted in ((-1.0009, True), (1.0011, False)):
        vector = np.full(3, 3.0 * limit)
        vector[axis] = share * limit
        guard, q = reaching(quantity, vector)
        problem = guard.admit(q, ZERO, servo_limits)
        assert (problem == "") is is_admitted
    assert f"angular {quantity} " in problem
    assert problem.endswith(f"about {'xyz'[axis]}, the limit is {limit:.6g} {UNITS[quantity]}")


def test_of_components_beyond_their_limits_the_farthest_is_named():
    guard, q = reaching("velocity", (2.2, 3.0, 1.0))
    servo_limits = replace(
        WIDE, axis_velocity=(2.0, 2.0, 2.0), axis_acceleration=(1e-3, 1e-3, 1e-3)
    )
    assert guard.admit(q, ZERO, servo_limits) == (
        "angular velocity 3 rad/s about y, the limit is 2 rad/s"
    )


@pytest.mark.parametrize("axes", [{}, dict.fromkeys(["axis_velocity", "axis_jerk"], (0.0,) * 3)])
def test_rounding_is_no_violation_even_of_a_limit_of_zero(axes):
    axes |= {"axis_acceleration": (0.0,) * 3} if axes else {}
    nothing = ServoLimits(0.0, 0.0, 0.0, 0.0, 0.0, 4.0, **axes)
    small, large = (exp((0.0, 0.0, turn)) for turn in (3.9e-15, 4.2e-15))
    assert Guard(PERIOD).admit(small, ZERO, nothing) == ""
    assert Guard(PERIOD).admit(large, ZERO, nothing) != ""
    assert Guard(PERIOD).admit(Q, (3.9e-15, 0.0, 0.0), nothing) == ""
    assert Guard(PERIOD).admit(Q, (4.2e-15, 0.0, 0.0), nothing) != ""


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_rounding_is_divided_by_the_period_as_often_as_the_rate(quantity):
    power = QUANTITIES.index(quantity) + 1
    for servo_limits in (
        replace(WIDE, **{quantity: 1e-30}),
        replace(WIDE, **{f"axis_{quantity}": (1e-30, 1e-30, 1e-30)}),
    ):
        for rounding, is_admitted in ((3.9e-15, True), (4.2e-15, False)):
            guard, q = reaching(quantity, (0.0, rounding / PERIOD**power, 0.0))
            assert (guard.admit(q, ZERO, servo_limits) == "") is is_admitted


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_rounding_comes_on_top_of_a_limit(quantity):
    rounding = 4e-15 / PERIOD ** (QUANTITIES.index(quantity) + 1)
    servo_limits = replace(WIDE, **{quantity: rounding})
    for share, is_admitted in ((2.0, True), (2.01, False)):
        guard, q = reaching(quantity, (0.0, share * rounding, 0.0))
        assert (guard.admit(q, ZERO, servo_limits) == "") is is_admitted


def test_what_is_within_its_tolerance_is_not_named():
    guard, q = reaching("jerk", (0.0, 0.0, 9000.0))
    guard.admit(q, ZERO, WIDE)
    most = {"acceleration": guard.alpha[2] / 1.0005, "velocity": guard.omega[2] / -1.0005}
    guard, q = reaching("jerk", (0.0, 0.0, 9000.0))
    problem = guard.admit(q, ZERO, replace(WIDE, jerk=8900.0, **most))
    assert problem == "angular jerk 9000 rad/s^3, the limit is 8900 rad/s^3"


def test_what_is_at_its_limit_is_not_named():
    guard = Guard(PERIOD)
    guard.alpha = (0.0, 0.0, 9000.0 * PERIOD)
    problem = guard.admit(Q, ZERO, replace(WIDE, velocity=0.0, acceleration=0.0, jerk=8900.0))
    assert problem == "angular jerk 9000 rad/s^3, the limit is 8900 rad/s^3"


def test_what_only_the_square_shows_to_be_too_large_is_refused_too():
    limit = 1.2e12
    most = limit * 1.001
    # Squares have finer steps than their roots.
    components = ((most * math.cos(t), most * math.sin(t)) for t in np.linspace(0.1, 1.4, 1000))
    x, y = next(
        (x, y)
        for x, y in components
        if x * x + y * y > most * most and math.sqrt(x * x + y * y) <= most
    )
    guard = Guard(1.0)
    guard.alpha = (x, y, 0.0)
    assert guard.admit(Q, ZERO, replace(WIDE, jerk=limit)) == (
        "a limit by the rounding of its differences"
    )


def test_what_was_admitted_is_what_is_differentiated_from():
    guard = Guard(PERIOD)
    first, second = (1e-5, -2e-5, 3e-5), (4e-5, -1e-5, 5e-5)
    place = (1e-5, 2e-5, -3e-5)
    assert guard.admit(exp(first), place, WIDE) == ""
    assert guard.admit(multiply(exp(first), exp(second)), place, WIDE) == ""
    np.testing.assert_allclose(guard.q, multiply(exp(first), exp(second)))
    np.testing.assert_allclose(guard.omega, np.array(second) / PERIOD)
    np.testing.assert_allclose(guard.alpha, (np.array(second) - first) / PERIOD**2)
    assert (guard.position, guard.velocity) == (place, ZERO)


def test_limits_that_change_count_at_once():
    guard = Guard(PERIOD)
    assert guard.admit(exp((1e-3, 0.0, 0.0)), ZERO, WIDE) == ""
    assert guard.admit(exp((2e-3, 0.0, 0.0)), ZERO, TERMS) != ""


@pytest.mark.parametrize("part", range(4))
def test_an_orientation_that_is_not_a_number_is_not_admitted(part):
    guard = Guard(PERIOD)
    q = tuple(math.nan if k == part else 0.5 for k in range(4))
    assert guard.admit(q, ZERO, replace(WIDE, axis_velocity=(1e3,) * 3)) != ""
    assert guard.q == Q


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_position_is_held_to_its_own_limits(axis):
    def along(value):
        return tuple(value if k == axis else 0.0 for k in range(3))

    for share, is_admitted in ((1.0009, True), (1.0011, False)):
        guard = Guard(PERIOD)
        guard.velocity = along(0.999)
        problem = guard.admit(Q, along(share * PERIOD), replace(TERMS, linear_acceleration=100.0))
        assert (problem == "") is is_admitted
    assert problem == "velocity 1.0011 m/s, the limit is 1 m/s"
    assert (guard.position, guard.velocity) == (ZERO, along(0.999))
    for share, is_admitted in ((1.0009, True), (1.0011, False)):
        guard = Guard(PERIOD)
        guard.velocity = along(0.5)
        # Where it was, as the velocity before has to be taken away.
        servo_limits = replace(TERMS, linear_acceleration=0.5 / PERIOD / share)
        problem = guard.admit(Q, ZERO, servo_limits)
        assert (problem == "") is is_admitted
    assert problem == f"acceleration 250 m/s^2, the limit is {0.5 / PERIOD / share:.6g} m/s^2"
    assert guard.admit(Q, (math.nan, 0.0, 0.0), TERMS) != ""
    guard = Guard(PERIOD)
    assert guard.admit(Q, along(0.01 * PERIOD), TERMS) == ""
    assert guard.position == along(0.01 * PERIOD)
    assert guard.velocity == pytest.approx(along(0.01))


def test_a_position_that_is_refused_leaves_the_orientation_too():
    guard = Guard(PERIOD)
    assert guard.admit(exp((1e-6, 0.0, 0.0)), (1.0, 0.0, 0.0), TERMS).startswith("velocity")
    assert (guard.q, guard.omega, guard.alpha) == (Q, ZERO, ZERO)


def test_the_rates_of_a_step_are_its_differences():
    guard = Guard(PERIOD)
    guard.anchor(exp((0.1, 0.0, 0.0)), (1.0, 2.0, 3.0))
    q = multiply(guard.q, exp((1e-3, -2e-3, 3e-3)))
    omega, velocity = guard.rates(q, (1.002, 1.996, 3.006))
    np.testing.assert_allclose(omega, (0.5, -1.0, 1.5))
    np.testing.assert_allclose(velocity, (1.0, -2.0, 3.0))
    assert guard.position == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_holding_takes_the_velocity_away(axis):
    guard = Guard(PERIOD)
    guard.omega = tuple(0.5 if k == axis else 0.0 for k in range(3))
    guard.velocity = (0.1, 0.0, 0.0)
    guard.hold()
    assert guard.alpha == tuple(-250.0 if k == axis else 0.0 for k in range(3))
    assert (guard.omega, guard.velocity) == (ZERO, ZERO)
    guard.hold()
    assert guard.alpha == ZERO


def test_a_position_stops_along_a_line_as_quickly_as_it_may():
    guard = Guard(PERIOD)
    guard.anchor(Q, (1.0, 0.0, 0.0))
    guard.velocity = (0.3, 0.0, 0.4)  # 0.02 m/s a cycle at 10 m/s^2
    assert guard.braked_position(TERMS) == pytest.approx(
        (1.0 + 0.3 * 0.96 * PERIOD, 0.0, 0.4 * 0.96 * PERIOD)
    )
    places = [place for _, place in stop_off_path(guard, TERMS)]
    assert len(places) == 25
    speeds = np.linalg.norm(np.diff([(1.0, 0.0, 0.0), *places], axis=0), axis=1) / PERIOD
    np.testing.assert_allclose(speeds, np.linspace(0.48, 0.0, 25), atol=1e-9)
    assert guard.velocity == ZERO


AXES = (1e9, 1e9, 1e9)


@pytest.mark.parametrize(
    ("limits", "omega", "alpha", "velocity", "most"),
    [
        # 20 rad/s^2 away at 401 rad/s^3, or 201 along one axis: 25 and 50 cycles; then the velocity
        # that was added meanwhile.
        ({"jerk": 401.0}, ZERO, (0.0, 12.0, 16.0), ZERO, 68),
        ({"axis_jerk": (201.0, 1e9, 1e9)}, ZERO, (20.0, 0.0, 0.0), ZERO, 136),
        # A velocity over an acceleration.
        ({"acceleration": 5.01}, (0.6, 0.8, 0.0), ZERO, ZERO, 104),
        ({"axis_acceleration": (1e9, 4.01, 1e9)}, (0.6, -0.8, 0.0), ZERO, ZERO, 130),
        ({"axis_acceleration": (1e9, 1e9, 5.01)}, (0.0, 0.0, -1.0), ZERO, ZERO, 104),
        # Twice the root of a velocity over a jerk.
        ({"jerk": 150.1}, (0.0, 1.0, 0.0), ZERO, ZERO, 84),
        # The velocity of the position over its acceleration.
        ({"linear_acceleration": 2.0}, ZERO, ZERO, (0.0, 0.3, 0.4), 126),
    ],
)
def test_a_stop_with_limits_of_components_is_as_long_as_they_ask_for(
    limits, omega, alpha, velocity, most
):
    limits = {"axis_velocity": AXES, **limits}
    servo_limits = replace(ServoLimits(1e9, 1e9, 1e9, 1e9, 1e9, 4.0), **limits)
    guard = Guard(PERIOD)
    guard.omega, guard.alpha, guard.velocity = omega, alpha, velocity
    sent = list(stop_off_path(guard, servo_limits))
    assert len(sent) <= most
    assert (guard.q, guard.position) == sent[-1]
    places = np.array([ZERO, *(place for _, place in sent)])
    q = np.array([Q, *(q for q, _ in sent)])
    turns = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    for rate, before, most_push in (
        (np.diff(places, axis=0) / PERIOD, velocity, servo_limits.linear_acceleration),
        ((turns[:-1].inv() * turns[1:]).as_rotvec() / PERIOD, omega, servo_limits.acceleration),
    ):
        pushes = np.diff(np.vstack([before, rate]), axis=0) / PERIOD
        assert np.linalg.norm(pushes, axis=1).max() <= most_push * 1.001
        assert np.linalg.norm(rate[-1]) <= 1e-9


def test_terms_cross_the_mailbox_unchanged():
    servo_limits = replace(ABOUT_Z, brake_rate=3.25)
    record = struct.pack(f"{LIMIT_FLOATS}d", *servo_limits.floats())
    assert ServoLimits.from_floats(struct.unpack(f"{LIMIT_FLOATS}d", record)) == servo_limits
    assert not ServoLimits.from_floats(TERMS.floats()).has_axes


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_axis_gains_speed_up_to_its_limit_in_either_direction(sign):
    guard, angle, speed = Guard(PERIOD), 0.0, 0.0
    guard.know([AxisLimits("pan", -9.0, 9.0, velocity=1.0, acceleration=10.0)])
    guard.anchor(Q, ZERO, (angle,))
    while speed < 0.99:
        speed += 5.0 * PERIOD
        angle += sign * speed * PERIOD
        assert guard.admit(Q, ZERO, TERMS, (angle,)) == ""
    problem = ""
    while not problem and speed < 1.1:
        speed += 5.0 * PERIOD
        angle += sign * speed * PERIOD
        problem = guard.admit(Q, ZERO, TERMS, (angle,))
    assert problem == "velocity 1.01 rad/s of pan, the limit is 1 rad/s"
