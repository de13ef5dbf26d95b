"""Measure curves through keyframes: those of orientd and of packages from PyPI."""

from __future__ import annotations

import statistics
import time

import numpy as np
from curve_speed import random_walk
from scipy.spatial.transform import RotationSpline

from orientd.curves import METHODS
from orientd.rotation import conjugate, log, multiply, to_scipy

COUNT, STEP = 12, 0.6  # keyframes, rad
END_VELOCITY = np.array([0.3, -0.2, 0.5])  # rad/s, body
INSTANTS, MANY = 100_000, 1000
H = 1e-3  # s, of finite differences


class Orientd:
    name, what = "orientd", "`c2_cumulative`"

    def __init__(self, keys, times, end_velocity=None):
        ends = {} if end_velocity is None else {"end": "clamped", "omega_end": end_velocity}
        self.curve = METHODS["c2_cumulative"](keys=keys, times=times, **ends)

    def q(self, times):
        return self.curve.evaluate(times)[0]

    def everything(self, times):
        self.curve.evaluate(times)


class SciPy:
    name, what = "SciPy", "`RotationSpline`"

    def __init__(self, keys, times):
        self.curve = RotationSpline(times, to_scipy(np.asarray(keys)))

    def q(self, times):
        return self.curve(times).as_quat(scalar_first=True)

    def everything(self, times):
        return self.curve(times).as_quat(), self.curve(times, 1), self.curve(times, 2)


class Splines:
    name, what = "splines", "`CatmullRom`"
    lacks = "α"

    def __init__(self, keys, times, end_velocity=None):
        from splines.quaternion import CatmullRom, UnitQuaternion

        ends = "natural" if end_velocity is None else ("natural", UnitQuaternion())
        units = [UnitQuaternion.from_unit_xyzw((*key[1:], key[0])) for key in np.asarray(keys)]
        self.curve = CatmullRom(units, list(times), endconditions=ends)

    def q(self, times):
        return np.array([(one.scalar, *one.vector) for one in self.curve.evaluate(times)])

    def everything(self, times):
        return self.curve.evaluate(times), self.curve.evaluate(times, 1)


class Drake:
    name, what = "Drake", "`PiecewiseQuaternionSlerp`"

    def __init__(self, keys, times):
        from pydrake.common.eigen_geometry import Quaternion
        from pydrake.trajectories import PiecewiseQuaternionSlerp

        units = [Quaternion(key) for key in np.asarray(keys)]
        self.curve = PiecewiseQuaternionSlerp(list(times), units)

    def q(self, times):
        return np.array([self.curve.orientation(t).wxyz() for t in times])

    def everything(self, times):
        curve = self.curve
        return [
            (curve.orientation(t), curve.angular_velocity(t), curve.angular_acceleration(t))
            for t in times
        ]


PEERS = (Orientd, SciPy, Splines, Drake)


def keyframes():
    """Return keyframes about random axes and their times."""
    keys = random_walk(COUNT, STEP)
    return keys, np.cumsum(np.random.default_rng(1).uniform(0.7, 1.3, COUNT))


def rates(curve, t, h):
    """Return angular velocity and acceleration at *t*, by differences on the side of *h* only."""
    q = curve.q(t + h * np.arange(4.0))
    omega = log(multiply(conjugate(q[:-1]), q[1:])) / h  # at h/2, 3h/2, 5h/2
    alpha = np.diff(omega, axis=0) / h  # at h, 2h
    return 1.5 * omega[0] - 0.5 * omega[1], 2.0 * alpha[0] - alpha[1]


def end_velocity(peer):
    """Return whether the curve meets a requested angular velocity at the end."""
    keys, times = keyframes()
    try:
        curve = peer(keys, times, END_VELOCITY)
    except TypeError:
        missed = rates(peer(keys, times), times[-1], -H)[0] - END_VELOCITY
        return f"not supported (off by {np.linalg.norm(missed):.2f})"
    except NotImplementedError:
        return "not implemented"
    missed = rates(curve, times[-1], -H)[0] - END_VELOCITY
    return f"met (off by {np.linalg.norm(missed):.0e})"


def steps(peer):
    """Return the largest steps of velocity and acceleration at a keyframe."""
    keys, times = keyframes()
    curve = peer(keys, times)
    sides = [(rates(curve, t, H), rates(curve, t, -H)) for t in times[1:-1]]
    return [max(float(np.linalg.norm(a[k] - b[k])) for a, b in sides) for k in (0, 1)]


def velocity_step(peer):
    return f"{steps(peer)[0]:.2g}"


def acceleration_step(peer):
    velocity, acceleration = steps(peer)
    return "ω steps" if velocity > 1e-3 else f"{acceleration:.2g}"


def sign_flip(peer):
    """Return the change of the curve if some keyframes are given as -q."""
    keys, times = keyframes()
    flipped = keys * np.where(np.arange(COUNT) % 3 == 1, -1.0, 1.0)[:, None]
    at = np.linspace(times[0], times[-1], 500)
    a, b = (peer(given, times).q(at) for given in (keys, flipped))
    moved = float(np.linalg.norm(log(multiply(conjugate(a), b)), axis=1).max())
    jumps = int(((a[1:] * a[:-1]).sum(axis=1) < 0.0).sum())
    text = "the same curve" if moved < 1e-9 else f"off by {moved:.2f} rad"
    return text + (f"; its q jumps {jumps} x" if jumps else "")


def half_turn(peer):
    """Return the curve's behaviour between two keyframes half a turn apart."""
    keys = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.6, 0.0, 0.0, 0.8]])
    curve = peer(keys, np.array([0.0, 1.0, 2.0]))
    q = curve.q(np.linspace(0.0, 2.0, 2001))
    turns = np.linalg.norm(log(multiply(conjugate(q[:-1]), q[1:])), axis=1)
    missed = min(np.linalg.norm(q[1000] - keys[1]), np.linalg.norm(q[1000] + keys[1]))
    if missed > 1e-6 or not np.isfinite(turns).all():
        return "missed"
    return f"passed, {turns.max() / 1e-3:.1f} rad/s"


def _median(work, rounds):
    work()
    taken = []
    for _ in range(rounds):
        begun = time.thread_time()
        work()
        taken.append(time.thread_time() - begun)
    return statistics.median(taken)


def sampling(peer):
    """Return the CPU time of orientation, velocity and acceleration at many sorted instants."""
    keys, times = keyframes()
    curve = peer(keys, times)
    at = np.linspace(times[0], times[-1], INSTANTS)
    seconds = _median(lambda: curve.everything(at), 1 if peer is Splines else 5) / INSTANTS
    lacks = getattr(peer, "lacks", "")
    return duration(seconds) + (f" (without {lacks})" if lacks else "")


def building(peer):
    """Return the CPU time to build a curve of many keyframes."""
    keys, times = random_walk(MANY, STEP), np.arange(float(MANY))
    return duration(_median(lambda: peer(keys, times), 5))


def duration(seconds):
    """Return a duration in a unit that suits it."""
    for unit, scale in (("ns", 1e9), ("µs", 1e6), ("ms", 1e3)):
        if seconds * scale < 1000.0:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds:.3g} s"


ROWS = (
    ("requested ω at the end, rad/s", end_velocity),
    ("largest step of ω at a keyframe, rad/s", velocity_step),
    ("largest step of α at a keyframe, rad/s²", acceleration_step),
    ("keyframes with mixed signs (q and −q)", sign_flip),
    ("keyframes half a turn and 1 s apart: largest ω", half_turn),
    (f"time to build a curve through {MANY:,} keyframes", building),
    (f"time per sample (q, ω, α), for {INSTANTS:,} instants", sampling),
)
