"""Errors of robots."""


class DeviceNotConnectedError(ConnectionError):
    """A robot is used that is not connected."""


class DeviceAlreadyConnectedError(ConnectionError):
    """A robot is connected twice."""
