"""How LeRobot makes a robot that it does not know."""

import importlib


def make_robot_from_config(config):
    """Return the robot: its class is in the package of its configuration, without ``Config``."""
    package = importlib.import_module(type(config).__module__.rpartition(".")[0])
    return getattr(package, type(config).__name__.removesuffix("Config"))(config)
