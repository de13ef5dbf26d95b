"""A command: connect a robot, calibrate it, disconnect it."""

import sys

from lerobot.robots import RobotConfig
from lerobot.robots.utils import make_robot_from_config
from lerobot.utils.import_utils import register_third_party_plugins


def main():
    """Calibrate the robot of the arguments ``--robot.NAME=VALUE``."""
    register_third_party_plugins()
    values = dict(word.removeprefix("--robot.").split("=", 1) for word in sys.argv[1:])
    robot = make_robot_from_config(RobotConfig.get_choice_class(values.pop("type"))(**values))
    robot.connect(calibrate=False)
    robot.calibrate()
    robot.disconnect()


if __name__ == "__main__":
    main()
