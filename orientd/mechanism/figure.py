"""A number that a certificate shows of the axes."""

from __future__ import annotations

from typing import NamedTuple


class Figure(NamedTuple):
    """One number that is certified of the axes of a motion.

    Attributes:
        name: of what, in words.
        value: in *unit*.
        unit: as it is written, for example ``rad/s``.
        limit: what was allowed, same unit; ``None`` if nothing limits it.
        time: when in the motion, s; ``None`` if it is no one instant.
    """

    name: str
    value: float
    unit: str
    limit: float | None = None
    time: float | None = None
