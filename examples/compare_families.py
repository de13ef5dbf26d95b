"""What some families of curves make of the same keyframes: a table and a sheet of pictures."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from orientd.curves import METHODS, CurveTask
from orientd.curves.comparison import compare, ranked
from orientd.plots import draw_sheet

FAMILIES = ("c2_cumulative", "squad", "kks_hermite_spline", "nu_spline", "piecewise_slerp")

keys = Rotation.from_euler("ZYX", [[0, 0, 0], [40, -20, 10], [80, 10, -20], [60, 40, 30]], True)
task = CurveTask(
    keys.as_quat(scalar_first=True),
    np.array([0.0, 1.0, 2.0, 3.0]),
    omega_start=np.zeros(3),
    omega_end=np.array([0.0, 0.0, 0.5]),
)
candidates = ranked(compare(task, families={name: METHODS[name] for name in FAMILIES}))
for candidate in candidates:
    figures = candidate.figures
    met = (
        "ends met" if figures.meets_ends else f"ends off by {figures.end_velocity_error:.2f} rad/s"
    )
    print(f"{candidate.name:20} C{figures.continuity}  effort {figures.effort:6.2f}  {met}")
draw_sheet(Path("families.svg"), task, candidates, title="Five families on four orientations")
