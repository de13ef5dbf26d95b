"""Draw the records of `test_gpredict.py`: angles and errors of a pass in each column.

``python tests/system/gpredict_picture.py FOLDER PICTURE``
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from orientd import rotation

INK, GRID = "#222222", "#dddddd"
STYLES = {False: ("positions only", "#c03a17"), True: ("with elements", "#183680")}
TITLES = {"zenith": "Near the zenith", "north": "Through north"}


def angles(q, near):
    """Return azimuth and elevation of the x axis of a tool, degrees; azimuths close to *near*."""
    x, y, z = rotation.rotate(q, [1.0, 0.0, 0.0]).T
    azimuth = np.degrees(np.arctan2(-y, x))
    return near + (azimuth - near + 180.0) % 360.0 - 180.0, np.degrees(np.arcsin(z))


def draw(folder, picture):
    """Draw the records in the folders of a folder."""
    records = [np.load(path) for path in sorted(Path(folder).glob("*/record.npz"))]
    figure = Figure((8.0, 6.0), layout="constrained")
    charts = figure.subplots(3, 2, sharex=True)
    for column, (name, title) in zip(charts.T, TITLES.items(), strict=True):
        column[0].set_title(title)
        for record in records:
            if record["name"] != name:
                continue
            is_known = bool(record["has_elements"])
            label, colour = STYLES[is_known]
            since = record["sent"] - record["peak"]
            column[2].plot(since, record["error"], color=colour, linewidth=0.9, label=label)
            if is_known:
                continue
            times, *asked = record["asked"].T
            middle = 270.0 if name == "zenith" else 0.0
            asked[0] = middle + (asked[0] - middle + 180.0) % 360.0 - 180.0
            seen = times > record["sent"][0]
            for chart, line, dots in zip(column, angles(record["q"], middle), asked, strict=False):
                chart.plot(since, line, color=INK, linewidth=0.9, label="setpoint")
                chart.plot((times - record["peak"])[seen], dots[seen], ".", markersize=3.5,
                           color=colour, label="position from gpredict")  # fmt: skip
        column[2].set_yscale("log")
        column[2].set_ylim(1e-4, 1.0)
        column[2].set_xlabel("time from the highest point, s")
        for chart in column:
            chart.grid(color=GRID, linewidth=0.6)
    for chart, label in zip(charts[:, 0], ("azimuth", "elevation", "error"), strict=True):
        chart.set_ylabel(f"{label}, degrees")
    for chart in charts[::2, 0]:
        chart.legend(frameon=False, fontsize=8)
    figure.savefig(picture, dpi=90)


if __name__ == "__main__":
    draw(*sys.argv[1:])
