"""Drive a device of orientd as a robot of LeRobot."""

import time

from lerobot_robot_orientd import Orientd, OrientdConfig

target = {"ee.x": 0.0, "ee.y": 0.0, "ee.z": 0.02, "ee.wx": 0.0, "ee.wy": 0.0, "ee.wz": 0.3}
with Orientd(OrientdConfig(time_to_live=0.2)) as robot:
    for _ in range(60):
        robot.send_action(target)
        time.sleep(1 / 30)
        observation = robot.get_observation()
print({name: round(observation[name], 2) for name in target})
