"""The quickest of 10,000 connectors between two states of motion, by the cross-entropy method.

A connector's rotation vector, from its beginning on, moves along three axes at right angles that
Ruckig times together.  Sought are these axes, how velocity, acceleration and jerk are shared
between them, and how much of each limit is used: the best of many draws from a normal distribution
are the centre of the next, narrower one (Rubinstein 1999).
"""

import numpy as np
from ruckig import InputParameter, Ruckig, RuckigError, Trajectory
from scipy.spatial.transform import Rotation

INSTANTS = 60
GENERATIONS = 100
TRIED = 100
"""In each generation, of which the best tenth is the centre of the next one."""

SPREAD = np.r_[[0.3] * 3, [0.6] * 9, [0.09] * 3]
NARROWED = 0.97


def rotation_vector_rate(turn, omega_body):
    """Return the rate of a rotation vector by the angular velocity, body frame, rad/s.

    The right Jacobian of SO(3) leads back (Sola, Deray and Atchuthan 2018, eq. 143).
    """
    size = np.linalg.norm(turn)
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    by_rate = np.eye(3) - (1.0 - np.cos(size)) / size**2 * cross
    return np.linalg.solve(by_rate + (size - np.sin(size)) / size**3 * cross @ cross, omega_body)


def timed(state, turn, rate_at_end, tried, limits):
    """Return rotation vectors, shape (INSTANTS, 3), and duration of a connector, or None."""
    axes = Rotation.from_rotvec(tried[:3])
    shares = np.exp(tried[3:12].reshape(3, 3))
    shares /= np.linalg.norm(shares, axis=1)[:, None]
    most = np.array([limits.velocity, limits.acceleration, limits.jerk]) * np.exp(tried[12:])
    velocity, acceleration, jerk = most[:, None] * shares
    target = axes.apply(rate_at_end)
    given = InputParameter(3)
    given.current_position = [0.0] * 3
    given.current_velocity = axes.apply(state.omega_body).tolist()
    given.current_acceleration = axes.apply(state.alpha_body).tolist()
    given.target_position = axes.apply(turn).tolist()
    given.target_velocity = target.tolist()
    given.max_velocity = np.maximum(velocity, 1.0001 * np.abs(target) + 1e-9).tolist()
    given.max_acceleration, given.max_jerk = acceleration.tolist(), jerk.tolist()
    found = Trajectory(3)
    try:
        if Ruckig(3).calculate(given, found).value < 0:
            return None
    except RuckigError:
        return None
    instants = np.linspace(0.0, found.duration, INSTANTS)
    return axes.inv().apply([found.at_time(t)[0] for t in instants]), found.duration


def excess(vectors, durations, limits):
    """Return how many times as long each connector has to be, by differences of its rotations."""
    q = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(-1, INSTANTS, 4)
    turns = Rotation.from_quat(q[:, :-1].reshape(-1, 4)).inv() * Rotation.from_quat(
        q[:, 1:].reshape(-1, 4)
    )
    rate, largest = turns.as_rotvec().reshape(len(q), -1, 3), []
    step = (durations / (INSTANTS - 1))[:, None, None]
    for power, name in enumerate(("velocity", "acceleration", "jerk"), 1):
        rate = (rate if power == 1 else np.diff(rate, axis=1)) / step
        shares = (
            np.linalg.norm(rate, axis=2).max(axis=1) / getattr(limits, name),
            (np.abs(rate) / limits.axes(name)).max(axis=(1, 2)),
        )
        largest.append(np.max(shares, axis=0) ** (1.0 / power))
    return np.max(largest, axis=0)


def searched(state, goal, omega_end, limits, random):
    """Return the least duration that is found, s.

    Args:
        state: where it begins.
        goal: orientation that it ends at, scalar first.
        omega_end: angular velocity there, body frame, rad/s.
        limits: to keep.
        random: a generator.
    """
    here = Rotation.from_quat(state.q, scalar_first=True)
    turn = (here.inv() * Rotation.from_quat(goal, scalar_first=True)).as_rotvec()
    rate_at_end = rotation_vector_rate(turn, omega_end)
    best, centre, spread = np.inf, np.zeros(15), SPREAD
    for _ in range(GENERATIONS):
        tried = centre + spread * random.normal(size=(TRIED, 15))
        ways = [timed(state, turn, rate_at_end, one, limits) for one in tried]
        is_found = np.array([way is not None for way in ways])
        if not is_found.any():
            continue
        vectors, durations = map(np.array, zip(*filter(None, ways), strict=True))
        over = excess(vectors, durations, limits)
        best = min(best, durations[over <= 1.0].min(initial=np.inf))
        order = np.argsort(durations * np.maximum(over, 1.0) ** 3)
        centre = tried[is_found][order[: max(3, len(order) // 10)]].mean(axis=0)
        spread = NARROWED * spread
    return best
