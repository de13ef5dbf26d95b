"""A path: orientation and position as functions of path time, constant before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orientd.curves.trajectory import Trajectory
from orientd.model.limits import STEADY, STILL
from orientd.model.request import Frame
from orientd.planner.path.position import PositionPath
from orientd.planner.state import State
from orientd.rotation import Floats, conjugate, rotate

Booleans = NDArray[np.bool_]

_AT_REST = 1e-9
"""Time before its end from which a path counts as ended, s; the last record is at rest."""


class PathSamples(NamedTuple):
    """A path at some instants, one row each.

    Attributes:
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``; the sign is continuous
            along the path.
        omega_body: angular velocities in the body frame, rad/s, shape ``(n, 3)``.
        alpha_body: their derivatives in body components, rad/s^2, shape ``(n, 3)``.
        position: of the tool in the world, m, shape ``(n, 3)``.
        velocity: its derivative, m/s, shape ``(n, 3)``.
    """

    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats

    def seen_in(self, frame: Frame) -> PathSamples:
        """Return the motion of a frame's tool relative to its base, if this is that of the flange.

        Args:
            frame: its base in the world, and its tool on the flange.
        """
        q, position = frame.pose(self.q, self.position)
        # A rotation about the flange moves the tool by its lever arm.
        lever = rotate(self.q, np.cross(self.omega_body, frame.tool.position))
        return self._replace(
            q=q,
            omega_body=frame.vector(self.omega_body),
            alpha_body=frame.vector(self.alpha_body),
            position=position,
            velocity=rotate(conjugate(frame.base.q), self.velocity + lever),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Orientation and position as functions of path time, constant before and after.

    Attributes:
        trajectory: the orientations, from path time 0 on.
        positions: the position.
    """

    trajectory: Trajectory
    positions: PositionPath

    @classmethod
    def joined(
        cls, parts: Sequence[Trajectory], positions: PositionPath, before: Floats | None = None
    ) -> Path:
        """Return the path of consecutive trajectories.

        Args:
            parts: end to end, from path time 0 on.
            positions: the position.
            before: the previous orientation of the device; the path continues its sign.
        """
        if not parts:
            raise ValueError("parts must not be empty")
        trajectory = Trajectory.joined(parts)
        if before is not None and float(trajectory.ends()[0][0] @ before) < 0.0:
            trajectory = trajectory.turned_over()
        return cls(trajectory, positions)

    @property
    def duration(self) -> float:
        """Path time from start to end, s."""
        return self.trajectory.domain[1]

    @property
    def first(self) -> Floats:
        """Orientation before path time 0."""
        q: Floats = self.trajectory.ends()[0][0]
        return q

    @property
    def last(self) -> Floats:
        """Orientation after the end."""
        q: Floats = self.trajectory.ends()[0][1]
        return q

    def joints_before(self, record: int) -> tuple[tuple[float, ...], ...]:  # noqa: ARG002
        """Return no joints: only a path planned for a device's axes has them."""
        return ()

    def sample(self, times: Floats) -> PathSamples:
        """Return the path at *times*, in any order; it is constant beyond its ends.

        Raises:
            ValueError: a time is NaN.
        """
        rows = self._rows(times)
        position, velocity, _ = self.positions.sample(times)
        if not self.positions.is_held:
            # A position may begin in motion while the orientation begins at rest.
            _, is_after = self._is_held(times)
            velocity[(times < 0.0) | is_after] = 0.0
            position[is_after] = self.positions.last
        return PathSamples(rows[:4].T, rows[4:7].T, rows[7:].T, position, velocity)

    def _is_held(self, times: Floats) -> tuple[Booleans, Booleans]:
        """Return whether *times* lie before the path or after it."""
        is_before = times <= 0.0 if self.begins_at_rest else times < 0.0
        return is_before, times >= self.duration - _AT_REST

    @property
    def begins_at_rest(self) -> bool:
        """Whether the angular velocity and acceleration are zero at path time 0."""
        _, omega, alpha = self.trajectory.ends()
        speed, size = math.hypot(*omega[0].tolist()), math.hypot(*alpha[0].tolist())
        return speed <= STILL and size <= STEADY

    def _rows(self, times: Floats) -> Floats:
        """Return orientations, velocities and accelerations at *times*, shape ``(10, n)``."""
        rows = self.trajectory.rows(times, np.empty((10, len(times))))
        is_before, is_after = self._is_held(times)
        rows[4:, is_before | is_after] = 0.0
        rows[:4, is_after] = self.last[:, None]
        return rows

    def state(self, time: float) -> State:
        """Return the state at *time*, with the derivatives of the piece that begins there."""
        q, omega, alpha = self.trajectory.sample(np.array([time]))
        if time <= 0.0 and self.begins_at_rest:
            omega, alpha = np.zeros((2, 1, 3))
        return State(q[0], omega[0], alpha[0], *self.positions.state(time))


def end_states(trajectory: Trajectory) -> tuple[State, State]:
    """Return the states at both ends of a trajectory, with positions at the origin."""
    q, omega, alpha = trajectory.ends()
    zero = np.zeros(3)
    return State(q[0], omega[0], alpha[0], zero), State(q[1], omega[1], alpha[1], zero)
