"""Measure motions within limits, of orientd and of packages from PyPI, on setpoints 2 ms apart.

The peers know of axes, not of orientations: they are given rotation vectors.  Of a limit on a norm
each component then gets the share ``1 / sqrt(3)``, with which the norm of the three is kept.
"""

from __future__ import annotations

import logging
import tempfile
import time
from pathlib import Path

import grpc
import numpy as np
from busy_clients import motion as wave
from peer_curves import duration
from servo_lateness import DEVICE, daemon

from orientd import rotation
from orientd.errors import PlanError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

PERIOD = 0.002
V, A, J = 2.0, 10.0, 100.0  # rad/s, rad/s^2, rad/s^3: of the norms
LIMITS = DEFAULT_LIMITS.with_rates({"velocity": V, "acceleration": A, "jerk": J})
SHARE = 1.0 / np.sqrt(3.0)
CASES = 20
NOT_RUN = "not run"


def excess(q):
    """Return the largest norms of velocity, acceleration and jerk of setpoints over the limits."""
    omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / PERIOD
    parts, ratios = omega, []
    for limit in (V, A, J):
        ratios.append(float(np.linalg.norm(parts, axis=1).max()) / limit)
        parts = np.diff(parts, axis=0) / PERIOD
    return ratios


def turned(q):
    """Return the total rotation of setpoints, degrees."""
    steps = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    return float(np.degrees(np.linalg.norm(steps, axis=1).sum()))


def aims():
    """Return cases of a start, a target and a new target, as rotation vectors."""
    random = np.random.default_rng(3)
    return [[random.uniform(-1.2, 1.2, 3) for _ in range(3)] for _ in range(CASES)]


class Orientd:
    name, what = "orientd", "norms, certified"

    @classmethod
    def go(cls, start, aim):
        here = State.at_rest(rotation.exp(start))
        return cls.aimed(aim, here)

    @staticmethod
    def aimed(aim, start):
        keyframe = Keyframe(tuple(rotation.exp(aim).tolist()))
        return plan(MotionRequest([keyframe]), start=start, limits=LIMITS, period=PERIOD)

    @staticmethod
    def setpoints(motion):
        return motion.records(0, motion.record_count)[:, :4]

    @classmethod
    def redirected(cls, start, aim, second):
        """Return setpoints, the step of the acceleration, and the time that planning took."""
        first = cls.go(start, aim)
        record = first.record_count // 3
        here = first.state_at(record)
        begun = time.thread_time()
        try:
            new = cls.aimed(second, here)
        except PlanError:
            return None
        taken = time.thread_time() - begun
        step = new.sample([0.0]).alpha_body[0] - here.alpha_body
        q = np.vstack([cls.setpoints(first)[:record], cls.setpoints(new)])
        return q, float(np.linalg.norm(step)), taken


class Ruckig:
    name, what = "Ruckig", "rotation vectors, 3 axes"

    @staticmethod
    def given(position, velocity, acceleration, aim):
        import ruckig

        given = ruckig.InputParameter(3)
        given.current_position, given.target_position = list(position), list(aim)
        given.current_velocity, given.current_acceleration = list(velocity), list(acceleration)
        given.max_velocity = [V * SHARE] * 3
        given.max_acceleration, given.max_jerk = [A * SHARE] * 3, [J * SHARE] * 3
        return given

    @classmethod
    def go(cls, start, aim, velocity=(0.0,) * 3, acceleration=(0.0,) * 3):
        import ruckig

        found = ruckig.Trajectory(3)
        ruckig.Ruckig(3).calculate(cls.given(start, velocity, acceleration, aim), found)
        return found

    @staticmethod
    def setpoints(found, end=None):
        times = np.arange(0.0, found.duration if end is None else end, PERIOD)
        return rotation.exp([found.at_time(t)[0] for t in times])

    @classmethod
    def redirected(cls, start, aim, second):
        first = cls.go(start, aim)
        end = PERIOD * round(first.duration / 3.0 / PERIOD)
        here = [np.array(part) for part in first.at_time(end)[:3]]
        begun = time.thread_time()
        new = cls.go(here[0], second, here[1], here[2])
        taken = time.thread_time() - begun
        step = np.array(new.at_time(0.0)[2]) - here[2]
        q = np.vstack([cls.setpoints(first, end - PERIOD / 2), cls.setpoints(new)])
        return q, float(np.linalg.norm(step)), taken


class Toppra:
    name, what = "TOPP-RA", "spline of rotation vectors"

    @staticmethod
    def solved(path, velocity, acceleration, sd_start=0.0):
        import toppra

        logging.getLogger("toppra").setLevel(logging.ERROR)
        box = [
            toppra.constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
            toppra.constraint.JointAccelerationConstraint(
                np.stack([-acceleration, acceleration], axis=1)
            ),
        ]
        solver = toppra.algorithm.TOPPRA(box, path, solver_wrapper="seidel")
        return solver.compute_trajectory(sd_start, 0.0)

    @classmethod
    def through(cls, points, sd_start=0.0, **how):
        import toppra

        path = toppra.SplineInterpolator(np.linspace(0.0, 1.0, len(points)), points, **how)
        return cls.solved(path, np.full(3, V * SHARE), np.full(3, A * SHARE), sd_start)

    @classmethod
    def go(cls, start, aim):
        return cls.through(np.array([start, 0.5 * (np.array(start) + aim), aim]))

    @staticmethod
    def setpoints(found, end=None):
        times = np.arange(0.0, found.duration if end is None else end, PERIOD)
        return rotation.exp(found(times))

    @classmethod
    def redirected(cls, start, aim, second):
        first = cls.go(start, aim)
        end = PERIOD * round(first.duration / 3.0 / PERIOD)
        q, rate, bend = (first(end, order) for order in range(3))
        begun = time.thread_time()
        # The path leaves in the direction of the present velocity, at its speed.
        new = cls.through(np.array([q, second]), 1.0, bc_type=((1, rate), (2, np.zeros(3))))
        taken = time.thread_time() - begun
        if new is None:
            return None
        q = np.vstack([cls.setpoints(first, end - PERIOD / 2), cls.setpoints(new)])
        return q, float(np.linalg.norm(new(0.0, 2) - bend)), taken


PEERS = (Orientd, Ruckig, Toppra)


def step_duration(peer):
    """Return the duration of a turn by 90 degrees about one axis over the shortest possible."""
    least = 0.5 * np.pi / V + V / A + A / J  # all three limits are reached
    aim = np.array([0.0, 0.0, 0.5 * np.pi])
    if peer is Ruckig:
        given = peer.given(np.zeros(3), np.zeros(3), np.zeros(3), aim)
        given.max_velocity, given.max_acceleration, given.max_jerk = [V] * 3, [A] * 3, [J] * 3
        import ruckig

        found = ruckig.Trajectory(3)
        ruckig.Ruckig(3).calculate(given, found)
    elif peer is Toppra:
        import toppra

        path = toppra.SplineInterpolator([0.0, 0.5, 1.0], np.array([0.0 * aim, 0.5 * aim, aim]))
        found = peer.solved(path, np.full(3, V), np.full(3, A))
    else:
        found = peer.go(np.zeros(3), aim)
    jerk = excess(np.vstack([peer.setpoints(found)]))[2]
    return f"{found.duration / least:.3f}" + (
        f", with {jerk:.0f} x the jerk" if jerk > 1.01 else ""
    )


def redirected(peer):
    found = [peer.redirected(*case) for case in aims()]
    return [one for one in found if one is not None]


def kept(peer):
    """Return the largest norms over their limits, for motions that get a new target."""
    found = redirected(peer)
    worst = np.max([excess(q) for q, _, _ in found], axis=0)
    failed = CASES - len(found)
    text = " / ".join(f"{ratio:.2f}" if ratio < 10.0 else f"{ratio:.0f}" for ratio in worst)
    return text + (f", {failed} of {CASES} failed" if failed else "")


def mean_duration(peer):
    """Return the mean duration of these motions."""
    return f"{PERIOD * np.mean([len(q) - 1 for q, _, _ in redirected(peer)]):.2f} s"


def acceleration_step(peer):
    """Return the largest step of the acceleration at the change of target."""
    return f"{max(step for _, step, _ in redirected(peer)):.1g}"


def planning(peer):
    """Return the median CPU time to plan the motion to the new target."""
    redirected(peer)
    return duration(float(np.median([taken for _, _, taken in redirected(peer)])))


def short_way(peer):
    """Return the rotation from +170 to -170 degrees about one axis, 20 degrees apart."""
    start, aim = (np.array([0.0, 0.0, np.radians(angle)]) for angle in (170.0, -170.0))
    return f"{turned(peer.setpoints(peer.go(start, aim))):.0f}°"


def same_curve(peer):
    """Return the duration on one curve with limits of velocity and acceleration per component."""
    if peer is Ruckig:
        return NOT_RUN
    most = {"velocity": [1.5, 1.2, 1.8], "acceleration": [4.0, 6.0, 5.0]}
    limits = DEFAULT_LIMITS.with_rates(most)
    random = np.random.default_rng(5)
    turns = np.cumsum(random.normal(size=(8, 3)) * 0.3, axis=0)
    keys = [tuple(q) for q in rotation.exp(turns - turns[0]).tolist()]
    keyframes, start = [Keyframe(key) for key in keys], State.at_rest(keys[0])
    if peer is Orientd:
        request = MotionRequest(keyframes)
        return f"{plan(request, start=start, limits=limits, period=PERIOD).duration:.3f} s"
    import toppra

    even = MotionRequest(keyframes, pace="even")
    motion = plan(even, start=start, limits=limits, period=PERIOD)
    stretch = motion.path.trajectory

    class Curve(toppra.interpolator.AbstractGeometricPath):
        """Omega and alpha are as linear in the rates of the parameter as those of joints."""

        path_interval, dof, waypoints = stretch.domain, 3, None

        def __call__(self, places, order=0):
            _, omega, alpha = stretch.sample(np.atleast_1d(np.asarray(places, dtype=float)))
            rows = omega if order == 1 else alpha if order == 2 else 0.0 * omega
            return rows if np.ndim(places) else rows[0]

    box = [np.array(most[name]) for name in ("velocity", "acceleration")]
    points = np.linspace(*stretch.domain, 3001)
    ends = [
        kind(np.stack([-most, most], axis=1))
        for kind, most in zip(
            (
                toppra.constraint.JointVelocityConstraint,
                toppra.constraint.JointAccelerationConstraint,
            ),
            box,
            strict=True,
        )
    ]
    solver = toppra.algorithm.TOPPRA(ends, Curve(), gridpoints=points, solver_wrapper="seidel")
    _, rate, _ = solver.compute_parameterization(0.0, 0.0)
    return f"{float(np.sum(2.0 * np.diff(points) / (rate[1:] + rate[:-1]))):.3f} s"


def stop(peer):
    """Return the path deviation of a stop: streamed through a daemon, or calculated."""
    if peer is Toppra:
        return NOT_RUN
    if peer is Orientd:
        summary = _streamed()
        return f"{summary.statistics.path_error:.0e} rad, streamed"
    import ruckig

    worst = 0.0
    for start, aim, second in aims():
        # A curved path: the second half of a motion that got a new target.
        first = peer.go(start, aim)
        here = first.at_time(first.duration / 3.0)
        path = peer.go(here[0], second, here[1], here[2])
        at = path.at_time(path.duration / 4.0)
        given = peer.given(*at[:3], second)
        given.control_interface = ruckig.ControlInterface.Velocity
        given.target_velocity = [0.0] * 3
        found = ruckig.Trajectory(3)
        ruckig.Ruckig(3).calculate(given, found)
        planned, left = peer.setpoints(path), peer.setpoints(found)
        worst = max(worst, *(float(rotation.angle(planned, q).min()) for q in left[::10]))
    return f"{worst:.0e} rad"


def _streamed():
    with (
        tempfile.TemporaryDirectory(prefix="orientd-peers-") as folder,
        daemon(Path(folder), 500.0, 0) as socket,
        grpc.insecure_channel(f"unix:{socket}") as channel,
    ):
        stub = control_stub(channel)
        token = stub.AcquireLease(pb.AcquireLeaseRequest(holder="peers")).lease.token
        call = stub.Move(pb.MoveRequest(lease_token=token, device=DEVICE, motion=wave()))
        next(call)
        time.sleep(2.0)
        stub.Stop(pb.StopRequest(device=DEVICE))
        (summary,) = [answer.summary for answer in call if answer.HasField("summary")]
    if summary.outcome != pb.OUTCOME_STOPPED:
        raise RuntimeError(f"it did not stop: {summary.text}")
    return summary


ROWS = (
    ("90° about one axis: duration divided by the shortest possible", step_duration),
    ("new target during the motion: norms of ω / α / jerk over their limits", kept),
    ("step of α at the change of target, rad/s²", acceleration_step),
    ("time to plan the motion to the new target", planning),
    ("rotation from +170° to −170°", short_way),
    (
        "duration through 8 keyframes, limits of ω and α (TOPP-RA: on the curve of an even pace)",
        same_curve,
    ),
    ("largest deviation from a curved path during a stop", stop),
)
