r"""A frame: where the base is that poses are given from, and where on the flange the tool is.

A device takes its setpoints as poses of its *flange* in its own *world*: for an arm, the tool
centre point that is set in its controller, seen from the arm's base.  A pose given in a frame is
that of the frame's tool, seen from the frame's base:

.. math::
    q_{world,flange} = q_{world,base} \, q_{base,tool} \, q_{flange,tool}^{-1}
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from orientd.driver import Quaternion, Vector3
from orientd.errors import RequestError
from orientd.rotation import Floats, check_unit, conjugate, multiply, rotate

MOST_FRAMES = 100
"""In one request."""

FARTHEST = 1e6
"""m from one frame to another, in every direction."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,31}")


@dataclass(frozen=True, slots=True)
class Pose:
    """Where one coordinate system is, seen from another.

    Attributes:
        q: orientation ``(w, x, y, z)``, of unit norm within 1e-6.
        position: of the origin, m.

    Raises:
        RequestError: one of them is not well formed.
    """

    q: Quaternion = (1.0, 0.0, 0.0, 0.0)
    position: Vector3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        try:
            w, x, y, z = check_unit(self.q).tolist()
        except (TypeError, ValueError) as error:
            raise RequestError("quaternion", str(error)) from error
        try:
            position = np.array(self.position, dtype=np.float64)
        except (TypeError, ValueError):
            position = np.zeros(0)
        # What is not a number is not below anything.
        if position.shape != (3,) or not np.all(np.abs(position) <= FARTHEST):
            expected = f"expected three numbers of at most {FARTHEST:g} m"
            raise RequestError("position", f"{expected}, got {self.position!r}")
        # The class is frozen for everybody but its own constructor.
        object.__setattr__(self, "q", (w, x, y, z))
        object.__setattr__(self, "position", tuple(position.tolist()))


@dataclass(frozen=True, slots=True)
class Frame:
    """What the pose of a keyframe is that of, and what it is seen from.

    Attributes:
        base: from where poses are seen, in the world: ``q_world_base`` and its origin.
        tool: what they are poses of, on the flange: ``q_flange_tool`` and its origin.
    """

    base: Pose = field(default_factory=Pose)
    tool: Pose = field(default_factory=Pose)

    def pose(self, q: ArrayLike, position: ArrayLike) -> tuple[Floats, Floats]:
        """Return orientation and position of the tool, seen from the base.

        Args:
            q: orientations of the flange in the world, shape ``(..., 4)``.
            position: of the flange in the world, m, shape ``(..., 3)``.
        """
        to_base = conjugate(self.base.q)
        from_base = np.asarray(position) + rotate(q, self.tool.position) - self.base.position
        return multiply(to_base, multiply(q, self.tool.q)), rotate(to_base, from_base)

    def vector(self, body: ArrayLike) -> Floats:
        """Return vectors in coordinates of the flange in those of the tool, shape ``(..., 3)``."""
        return rotate(conjugate(self.tool.q), body)


def named_frames(given: Mapping[str, Frame]) -> Mapping[str, Frame]:
    """Return *given* as nobody can change it any more.

    Raises:
        RequestError: there are too many, or a name is none.
    """
    if len(given) > MOST_FRAMES:
        raise RequestError("frames", f"expected at most {MOST_FRAMES}, got {len(given)}")
    for name in given:
        if not _NAME.fullmatch(name):
            expected = "expected a letter, then at most 31 letters, digits, '-' or '_'"
            raise RequestError("frames", f"{expected}, got {name!r}")
    return MappingProxyType(dict(given))
