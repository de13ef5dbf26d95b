"""The pictures of satellite passes in the how-to guide: plans for its own rotator, drawn."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orientd import config
from orientd.planner.motion import Motion
from orientd.plots.paper import new_figure, save
from orientd.rotation import Floats, rotate
from orientd_rotctld import satellite_pass

PAGE = Path("how-to/satellite-pass.md")
RATE = 0.6  # degrees/s, of a low orbit at its highest point
FINE = 0.05  # s


@dataclass(frozen=True)
class Sky:
    """A pass over a place.

    Attributes:
        name: of its picture.
        miss: from the zenith, degrees.
        heading: degrees from north.
        azimuth: range of the rotator's axis, degrees.
    """

    name: str
    miss: float
    heading: float
    azimuth: tuple[float, float]


PASSES = (
    Sky("pass-zenith", 0.8, 0.0, (0.0, 450.0)),
    Sky("pass-north", 30.0, 270.0, (0.0, 450.0)),
)


def angles(times: Floats, miss: float, heading: float) -> tuple[Floats, Floats]:
    """Return compass azimuth and elevation of a pass, degrees, highest at 120 s."""
    turn = np.radians(RATE) * (times - 120.0)
    ahead, aside = np.sin(turn), np.sin(np.radians(miss)) * np.cos(turn)
    azimuth = heading + np.degrees(np.unwrap(np.arctan2(aside, ahead)))
    return azimuth, np.degrees(np.arcsin(np.cos(np.radians(miss)) * np.cos(turn)))


def planned(sky: Sky, table: str) -> tuple[Motion, Floats, Floats]:
    """Return the plan of a pass, its times, and the error at them in degrees."""
    whole = np.arange(0.0, 241.0)
    request = satellite_pass(whole, *angles(whole, sky.miss, sky.heading))
    content = tomllib.loads(table)
    content["devices"]["antenna"]["options"]["axes"][0]["limits_deg"] = list(sky.azimuth)
    settings = config.parse(content, source="the guide").devices["antenna"]
    motion = settings.planner().plan_offline(request)
    times = np.arange(0.0, 240.0, FINE)
    made = rotate(motion.sample(motion.start_time + times).q, [1.0, 0.0, 0.0])
    east, height = map(np.radians, angles(times, sky.miss, sky.heading))
    level = np.cos(height)
    asked = np.column_stack([level * np.cos(east), -level * np.sin(east), np.sin(height)])
    across = np.linalg.norm(np.cross(made, asked), axis=1)
    return motion, times, np.degrees(np.arctan2(across, np.sum(made * asked, axis=1)))


def draw(sky: Sky, table: str, path: Path) -> None:
    """Draw the axes, the angles of the satellite and the error of a plan."""
    motion, times, error = planned(sky, table)
    azimuth, elevation = angles(times, sky.miss, sky.heading)
    first = round(motion.start_time / motion.period)
    joints = np.degrees(motion.path.joints[first:])
    own = motion.period * np.arange(len(joints))
    figure = new_figure(8.0, 5.4, f"At least {sky.miss:g}° from the zenith")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    lost = [(one.start - motion.start_time, one.end - motion.start_time)
            for one in motion.certificate.losses]  # fmt: skip
    for chart in (top, bottom):
        for span in lost:
            chart.axvspan(*span, color="#f2d9d3", linewidth=0)
    top.plot(times, azimuth, color="#999999", linestyle="--", label="azimuth of the satellite")
    top.plot(times, elevation, color="#999999", linestyle=":", label="elevation of the satellite")
    top.plot(own, joints[:, 0], color="#1f5fa8", label="azimuth axis")
    top.plot(own, joints[:, 1], color="#c2571a", label="elevation axis")
    top.set_ylabel("degrees")
    top.legend(frameon=False, fontsize=8)
    bottom.plot(times, error, color="#333333")
    bottom.axhline(0.5, color="#999999", linewidth=0.8)
    bottom.set_yscale("log")
    bottom.set_ylim(1e-5, 90.0)
    bottom.set_ylabel("error, degrees")
    bottom.set_xlabel("seconds of the pass; shaded: lost by more than 0.5°")
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Draw the pictures; there is no page to write."""
    text = (source / PAGE).read_text(encoding="utf-8")
    table = text.partition("```{code-block} toml\n")[2].partition("```")[0].partition("\n\n")[2]
    for sky in PASSES:
        path = source / "how-to" / "pictures" / f"{sky.name}.png"
        if not path.exists():
            draw(sky, table, path)
    yield from ()
