"""Seeded requests for planners, each with a judge that shares no code with them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise, product

import numpy as np

SUPPORTED = [
    "".join(letters)
    for count in (2, 3)
    for letters in product("XYZ", repeat=count)
    if all(a != b for a, b in pairwise(letters))
]
ORDERS = ("ZYX", "ZXY", "ZY", "XY", *SUPPORTED)
"""The common orders of axes, which come twice as often, and every supported one."""
RANGES = (
    ((-270, 270), (-180, 180), (-160, 160), (0, 450)),
    ((-100, 100), (-60, 90), (-45, 200)),
    ((-120, 120), (-40, 40), (-180, 180)),
)
"""Ranges of the axes from the base to the tool, degrees."""
INSIDE = 1.0
"""Distance from the ends of the ranges at which a direction is surely within reach, degrees."""
CLOSE = 0.05
"""Largest angle, degrees, from a direction at which axis angles point there."""


@dataclass(frozen=True)
class Pointing:
    """A gimbal, where it stands, and a direction for it.

    Attributes:
        order: the axes from the base to the tool.
        ranges: of the axes, degrees.
        begin: axis angles at the start, degrees.
        axis: of the tool, ``x``, ``y`` or ``z``.
        direction: unit vector in the base.
    """

    order: str
    ranges: tuple[tuple[float, float], ...]
    begin: tuple[float, ...]
    axis: str
    direction: tuple[float, float, float]

    def aims(self, angles: np.ndarray) -> np.ndarray:
        """Return where axis angles point, degrees, shape ``(..., axes)`` to ``(..., 3)``."""
        aim = np.broadcast_to(np.eye(3)["xyz".index(self.axis)], (*angles.shape[:-1], 3))
        turns = zip(self.order, np.moveaxis(np.radians(angles), -1, 0), strict=True)
        return reduce(lambda v, turn: _turned(v, *turn), reversed(list(turns)), aim)

    def apart(self, angles: np.ndarray) -> np.ndarray:
        """Return how far from the direction axis angles point, all in degrees."""
        return np.degrees(2.0 * np.arcsin(
            np.clip(0.5 * np.linalg.norm(self.aims(angles) - self.direction, axis=-1), 0.0, 1.0)
        ))  # fmt: skip

    def is_within_reach(self) -> bool:
        """Search the axis angles for the direction, on a grid that becomes finer and finer."""
        low, high = (np.array(ends) for ends in zip(*self.ranges, strict=True))
        low, high, step = low + INSIDE, high - INSIDE, 6.0
        high = np.minimum(high, low + 360.0)
        grid = [np.append(np.arange(a, b, step), b) for a, b in zip(low, high, strict=True)]
        found = np.stack(np.meshgrid(*grid), axis=-1).reshape(-1, len(low))
        offsets = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(low))))
        while step > CLOSE:
            found = found[np.argsort(self.apart(found))[:100]]
            step *= 0.5
            near = (found[:, None] + step * offsets).reshape(-1, len(low))
            found = np.unique(np.clip(near, low, high), axis=0)
        return bool(np.min(self.apart(found)) < CLOSE)


def pointings(seed: int) -> Iterator[Pointing]:
    """Yield directions for gimbals without end: behind, above, and anywhere."""
    rng = np.random.default_rng(seed)
    while True:
        order = ORDERS[rng.integers(len(ORDERS))]
        ranges = tuple(some[rng.integers(len(some))] for some in RANGES[: len(order)])
        begin = (0.0,) * len(order)
        if rng.random() < 0.5:
            begin = tuple(float(rng.uniform(*ends)) for ends in ranges)
        axis = "xyz"[rng.integers(3)] if rng.random() < 0.3 else "x"
        if len(order) == 2:
            # Two axes point the axis about which they cannot turn.
            (axis,) = set("xyz") - set(order.lower())
        direction = rng.normal(size=3)
        kind = rng.integers(3)
        if kind == 0:
            direction += 3.0 * np.array([-1.0, 0.0, 0.0])
        elif kind == 1:
            direction = 0.2 * direction + np.array([0.0, 0.0, 1.0])
        direction /= np.linalg.norm(direction)
        yield Pointing(order, ranges, begin, axis, tuple(direction.tolist()))


def _turned(vectors: np.ndarray, letter: str, angle: np.ndarray) -> np.ndarray:
    """Return vectors turned about a coordinate axis."""
    k = "XYZ".index(letter)
    i, j = (k + 1) % 3, (k + 2) % 3
    turned = np.array(vectors, dtype=float)
    turned[..., i] = np.cos(angle) * vectors[..., i] - np.sin(angle) * vectors[..., j]
    turned[..., j] = np.sin(angle) * vectors[..., i] + np.cos(angle) * vectors[..., j]
    return turned
