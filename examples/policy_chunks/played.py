"""Compare players of the same chunks of a policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orientd import rotation
from orientd.plots.paper import GRID, LIMIT, SERIES, check_format, new_figure, save, tidy
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True)
class Played:
    """Setpoints at even times.

    Attributes:
        name: of the player.
        begin: time of the first setpoint, s.
        period: from one setpoint to the next, s.
        q: orientations, shape ``(n, 4)``.
    """

    name: str
    begin: float
    period: float
    q: Floats

    @property
    def velocity(self) -> Floats:
        """Angular velocity of every step, shape ``(n - 1, 3)``, rad/s."""
        return rotation.log(rotation.between(self.q[:-1], self.q[1:])) / self.period

    @property
    def steps(self) -> Floats:
        """Angles between successive setpoints, shape ``(n - 1,)``, rad."""
        return rotation.angle(self.q[:-1], self.q[1:])

    @property
    def acceleration(self) -> Floats:
        """Size of the angular acceleration between two steps, shape ``(n - 2,)``, rad/s^2."""
        sizes: Floats = np.linalg.norm(np.diff(self.velocity, axis=0), axis=1) / self.period
        return sizes

    @property
    def turned(self) -> Floats:
        """How far it has turned in all, to and fro, shape ``(n - 1,)``, rad."""
        turned: Floats = np.cumsum(self.steps)
        return turned


def draw_played(
    path: Path, players: Sequence[Played], limit: float, arrivals: Sequence[float], *, title: str
) -> None:
    """Draw turn and acceleration of *players* to *path*.

    Args:
        path: of the picture.
        players: at most seven.
        limit: of the angular acceleration, rad/s^2.
        arrivals: when each chunk arrived, s.
        title: above the picture.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    figure = new_figure(10.0, 7.5, title)
    turn, *rows = figure.subplots(1 + len(players), 1, sharex=True)
    for axes in rows[1:]:
        axes.sharey(rows[0])
    for style, player, axes in zip(SERIES, players, rows, strict=False):
        times = player.begin + player.period * np.arange(len(player.q))
        look = {"color": style.colour, "linestyle": style.stroke, "label": player.name}
        turn.plot(times[1:], np.degrees(player.turned), linewidth=1.8, **look)
        sizes = np.maximum(player.acceleration, 1e-1)
        axes.semilogy(times[2:], sizes, linewidth=0.9, color=style.colour)
        axes.axhline(limit, color=LIMIT, linewidth=1.2)
        tidy(axes, "rad/s²")
        axes.set_title(f"angular acceleration: {player.name}", fontsize=9, loc="left")
    for axes in (turn, *rows):
        for when in arrivals:
            axes.axvline(when, color=GRID, linewidth=0.6, zorder=0)
    tidy(turn, "degrees")
    turn.set_title("turned in all", fontsize=9, loc="left")
    turn.legend(fontsize=9, frameon=False)
    rows[-1].set_xlabel("time, s; grey: a chunk arrives, violet: the device's limit", fontsize=9)
    save(figure, path)
