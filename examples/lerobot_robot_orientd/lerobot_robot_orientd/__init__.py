"""Devices of orientd as robots of LeRobot."""

from lerobot_robot_orientd.config import OrientdConfig
from lerobot_robot_orientd.robot import Orientd
