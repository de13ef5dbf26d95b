"""How far an arm's tool leaves the straight line to a target at rest.

The joints of an arm take one step together, so its tool moves on a curve to a target that jumped.
"""

from __future__ import annotations

from itertools import pairwise
from math import dist

from orientd.driver import Quaternion, Vector3
from orientd.floats import difference, dot, norm, plus

ANOTHER, ANOTHER_TURN = 1e-3, 2e-3
"""How far from the last one a target begins another line, m and rad; nearer ones are its noise."""

THERE, TURNED = 1e-4, 1e-3
"""Within which the tool has arrived at a target, m and rad."""

Pose = tuple[Quaternion, Vector3]


class StraightLine:
    """The line from where the tool stood, or would come to rest, when a target came.

    Attributes:
        deviation: distance of the tool from the line, m; 0 without one.
        largest: the largest that it has been, m.
    """

    def __init__(self) -> None:
        """Know no target yet."""
        self._goal: Pose | None = None
        self._corners: list[Vector3] = []
        self.deviation = self.largest = 0.0

    def clear(self) -> None:
        """Have no target at rest."""
        if self._goal is not None:
            self._goal, self._corners, self.deviation = None, [], 0.0

    def leads_to(self, goal: Pose) -> bool:
        """Return whether the line, if there is one, leads to this target."""
        before = self._goal
        return before is not None and _is_near(before, goal, ANOTHER, ANOTHER_TURN)

    def begin(self, goal: Pose, at: Vector3, rest: Vector3) -> None:
        """Begin a line to *goal* for a tool at the position *at* that would stop at *rest*."""
        self._goal, self._corners = goal, [at, rest, goal[1]]

    def note(self, pose: Pose) -> None:
        """Note the pose of a setpoint."""
        goal = self._goal
        if goal is None:
            return
        if _is_near(goal, pose, THERE, TURNED):
            self._corners = []
        self.deviation = self.distance(pose[1])
        self.largest = max(self.largest, self.deviation)

    def distance(self, position: Vector3) -> float:
        """Return the distance of a position from the line, m; 0 without one."""
        return min((_from(position, a, b) for a, b in pairwise(self._corners)), default=0.0)


def _is_near(a: Pose, b: Pose, way: float, turn: float) -> bool:
    return dist(a[1], b[1]) < way and norm(difference(a[0], b[0])) < turn


def _from(position: Vector3, a: Vector3, b: Vector3) -> float:
    """Return the distance of a position from the line between two points."""
    along, way = plus(b, a, -1.0), plus(position, a, -1.0)
    square = dot(along, along)
    share = min(max(dot(way, along) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return norm(plus(way, along, -share))
