"""A pass like a satellite's, up to 80 degrees of elevation and down, on a three-axis gimbal.

First: orientd sim dynamixel --link /tmp/gimbal, and orientd run --config config/gimbal.toml.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import orientd

share = np.linspace(0.0, 1.0, 9)
azimuth = np.degrees(np.arctan2(np.sin(np.pi * (share - 0.5)), 0.3 + np.cos(np.pi * (share - 0.5))))
elevation = 80.0 * np.sin(np.pi * share)
angles = np.column_stack([azimuth, -elevation, np.zeros_like(share)])

with orientd.connect() as robot:
    plan = robot.plan(Rotation.from_euler("ZYX", angles, degrees=True), approach=True)
    for figure in plan.certificate.figures:
        limit = f" of {figure.limit:.4g}" if figure.HasField("limit") else ""
        print(f"{figure.name}: {figure.value:.4g}{limit} {figure.unit}")
    print(orientd.word(robot.move(plan).wait(), "outcome"))
