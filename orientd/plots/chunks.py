"""Compare what two players make of the same chunks of a policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orientd import rotation
from orientd.plots.paper import LIMIT, SERIES, check_format, new_figure, save, tidy
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True)
class Played:
    """Setpoints at even times.

    Attributes:
        name: of the player.
        period: from one setpoint to the next, s.
        q: orientations, shape ``(n, 4)``.
    """

    name: str
    period: float
    q: Floats

    @property
    def velocity(self) -> Floats:
        """Angular velocity of every step, shape ``(n - 1, 3)``, rad/s."""
        return rotation.log(rotation.between(self.q[:-1], self.q[1:])) / self.period

    @property
    def acceleration(self) -> Floats:
        """Size of the angular acceleration between two steps, shape ``(n - 2,)``, rad/s^2."""
        sizes: Floats = np.linalg.norm(np.diff(self.velocity, axis=0), axis=1) / self.period
        return sizes

    @property
    def turned(self) -> Floats:
        """How far it has turned in all, to and fro, shape ``(n - 1,)``, rad."""
        turned: Floats = np.cumsum(np.linalg.norm(self.velocity, axis=1)) * self.period
        return turned


def draw_played(path: Path, players: Sequence[Played], limit: float, *, title: str) -> None:
    """Draw turn and acceleration of *players*, with the *limit* of the latter, to *path*.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    figure = new_figure(10.0, 7.0, title)
    turn, acceleration = figure.subplots(2, 1, sharex=True)
    for style, player in zip(SERIES, players, strict=False):
        times = player.period * np.arange(len(player.q))
        look = {"color": style.colour, "linestyle": style.stroke, "label": player.name}
        turn.plot(times[1:], np.degrees(player.turned), linewidth=1.4, **look)
        sizes = np.maximum(player.acceleration, 1e-2)
        acceleration.semilogy(times[2:], sizes, linewidth=0.9, **look)
    acceleration.axhline(limit, color=LIMIT, linewidth=1.0, label="limit of the device")
    tidy(turn, "turned in all, degrees")
    tidy(acceleration, "angular acceleration, rad/s²")
    acceleration.set_xlabel("time, s", fontsize=9)
    turn.legend(fontsize=9, frameon=False)
    acceleration.legend(fontsize=9, frameon=False)
    save(figure, path)
