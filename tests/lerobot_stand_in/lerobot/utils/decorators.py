"""Decorators of the methods of a robot."""

import functools

from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError


def check_if_not_connected(method):
    """Let a method refuse a robot that is not connected."""
    return _checked(method, lambda robot: robot.is_connected, DeviceNotConnectedError)


def check_if_already_connected(method):
    """Let a method refuse a robot that is connected."""
    return _checked(method, lambda robot: not robot.is_connected, DeviceAlreadyConnectedError)


def _checked(method, is_right, error):
    @functools.wraps(method)
    def checked(robot, *args, **kwargs):
        if not is_right(robot):
            raise error(method.__name__)
        return method(robot, *args, **kwargs)

    return checked
