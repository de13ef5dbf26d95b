"""Motions past the pole of a gimbal with the servos of the example configuration."""

import numpy as np

from emulated_dynamixel import ManualClock
from orientd.model.limits import Limits
from orientd_dynamixel import DynamixelDriver

PERIOD = 0.01
LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
AXES = [
    {
        "id": k + 1,
        "name": name,
        "limits_deg": [-270, 270],
        "velocity_deg": 220,
        "acceleration_deg": 2290,
    }
    for k, name in enumerate(("yaw", "pitch", "roll"))
]


def over_the_top(miss_deg, seconds=None):
    """Return a motion that turns over by 150 degrees, missing the pole by *miss_deg*."""
    miss = np.deg2rad(miss_deg)
    axis = np.array([0, -np.cos(miss), np.sin(miss)])
    keyframes = [
        {"rotation_vector": (np.deg2rad(sweep) * axis).tolist()}
        | ({} if seconds is None else {"time": seconds * sweep / 150})
        for sweep in np.linspace(0, 150, 7)
    ]
    return {"keyframes": keyframes, "approach": True}


def driver_with(**options):
    settings = {"port": "virtual", "axes": AXES, **options}
    return DynamixelDriver(settings, period_ns=10_000_000, clock=ManualClock(1))
