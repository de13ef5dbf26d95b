"""A figure about the axes that a certificate shows."""

from __future__ import annotations

from typing import NamedTuple


class Figure(NamedTuple):
    """One certified number about the axes of a motion.

    Attributes:
        name: the quantity, in words.
        value: in *unit*.
        unit: unit as text, for example ``rad/s``.
        limit: allowed value, same unit; ``None`` if nothing limits it.
        time: when the value occurs in the motion, s; ``None`` if not at one instant.
    """

    name: str
    value: float
    unit: str
    limit: float | None = None
    time: float | None = None
