"""A camera that is triggered once the device is measured to be on target.  First: orientd run."""

from math import radians

from scipy.spatial.transform import Rotation

import orientd

ON_TARGET = orientd.OnTarget(tolerance=radians(0.1), rate=radians(0.5), settle_time=0.1)


def take_picture(name: str) -> None:
    """Stand in for a camera."""
    print(f"picture {name}")


with orientd.connect() as robot:
    device = robot.devices()[0].name
    for yaw in (-15, 0, 15):
        motion = robot.move(
            [Rotation.from_euler("z", yaw, degrees=True)], device=device, on_target=ON_TARGET
        )
        if motion.wait().HasField("settled_after"):
            take_picture(f"at {yaw} degrees")
