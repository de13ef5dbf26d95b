"""Packages of others, which LeRobot finds by their names."""

import importlib
import pkgutil


def register_third_party_plugins():
    """Import every package whose name begins as that of a robot."""
    for module in pkgutil.iter_modules():
        if module.name.startswith("lerobot_robot_"):
            importlib.import_module(module.name)
