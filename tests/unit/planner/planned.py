"""Random requests, and an eye on motions that shares no code with the planner's certificate."""

import numpy as np
from scipy.spatial.transform import Rotation

from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

PERIOD = 0.002

# From a quick gimbal to a sluggish telescope.
LIMITS = {
    "arm": Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    "soft": Limits(1.0, 3.0, 40.0, 0.5, 5.0),
    "slow": Limits(0.3, 0.4, 5.0, 0.2, 0.5),
    "quick": Limits(10.0, 200.0, 3e4, 3.0, 30.0),
}


def rotations(random, count, step):
    """Return quaternions (w, x, y, z), each a turn of *step* rad away from the one before."""
    turns = random.normal(size=(count - 1, 3))
    turns *= step / np.linalg.norm(turns, axis=1, keepdims=True)
    rotation = Rotation.random(rng=random)
    found = [rotation]
    for turn in turns:
        found.append(found[-1] * Rotation.from_rotvec(turn))
    # Either sign is the same orientation.
    signs = random.choice([-1.0, 1.0], size=count)
    return [tuple((s * r.as_quat()[[3, 0, 1, 2]]).tolist()) for s, r in zip(signs, found)]  # noqa: B905


def vector(random, length):
    direction = random.normal(size=3)
    return tuple((length * direction / np.linalg.norm(direction)).tolist())


def anywhere(random):
    return State.at_rest(rotations(random, 2, 1.0)[0], random.uniform(-1, 1, 3))


def random_request(random, limits, **changes):
    """Return a request without times; *changes* replace its fields."""
    count = int(random.integers(2, 9))
    has_positions = random.random() < 0.3
    velocities = [
        vector(random, limits.velocity * random.uniform(0.05, 0.7))
        if random.random() < 0.5
        else None
        for _ in range(2)
    ]
    keyframes = [
        Keyframe(
            q,
            position=tuple(random.uniform(-0.3, 0.3, 3)) if has_positions else None,
        )
        for q in rotations(random, count, random.uniform(0.05, 2.8))
    ]
    fields = {
        "start_velocity": velocities[0],
        "end_velocity": velocities[1],
        "velocity_frame": str(random.choice(["body", "world"])),
        "approach": True,
    }
    return MotionRequest(keyframes, **{**fields, **changes})


def timed(motion, random):
    """Return the request of a motion with its own times given, as a user would."""
    request = motion.request
    times = motion.keyframe_times - motion.start_time + random.uniform(-5, 5)
    return MotionRequest(
        [
            Keyframe(k.q, float(t), k.position, k.turns)
            for k, t in zip(request.keyframes, times, strict=True)
        ],
        method=request.method,
        start_velocity=request.start_velocity,
        end_velocity=request.end_velocity,
        velocity_frame=request.velocity_frame,
        approach=request.approach,
    )


def random_motions(seed, count, limits, *, period=PERIOD, **changes):
    """Return planned motions, every other one of them with times."""
    random = np.random.default_rng(seed)
    motions = []
    while len(motions) < count:
        start = anywhere(random)
        # Times of an even pace are ones that a curve through the keyframes can keep.
        pace = {"pace": "even"} if len(motions) % 2 else {}
        motion = plan(
            random_request(random, limits, **pace, **changes),
            start=start,
            limits=limits,
            period=period,
        )
        if len(motions) % 2:
            try:
                motion = plan(timed(motion, random), start=start, limits=limits, period=period)
            except PlanError:
                continue
        motions.append(motion)
    return motions


def differences(q, period, *, start=None):
    """Return lengths of velocity, acceleration and jerk, from rest to rest, by SciPy."""
    first = q[0] if start is None else start
    q = np.concatenate([[first] * 3, q, [q[-1]] * 3])
    rotation = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    omega = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / period
    alpha = np.diff(omega, axis=0) / period
    jerk = np.diff(alpha, axis=0) / period
    return tuple(np.linalg.norm(rate, axis=1) for rate in (omega, alpha, jerk))


def times_of(motion):
    return motion.period * np.arange(motion.record_count)
