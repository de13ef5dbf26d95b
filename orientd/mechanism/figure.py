"""Figures of a certificate about the axes, and the intervals in which they lose their target."""

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


class Loss(NamedTuple):
    """An interval of a motion in which the axes do not point where the path does.

    Attributes:
        start: s from the beginning of the motion.
        end: s.
        error: largest angle to the requested direction in it, rad.
    """

    start: float
    end: float
    error: float
