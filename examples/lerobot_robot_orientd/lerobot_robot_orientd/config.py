"""Settings of a robot: ``--robot.type=orientd``."""

from dataclasses import dataclass

from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("orientd")
@dataclass(kw_only=True)
class OrientdConfig(RobotConfig):
    """Which device to drive.

    Attributes:
        socket: of the daemon, as :func:`orientd.connect` takes it; ``None`` for the usual one.
        device: its name; may be empty if the daemon has only one.
        time_to_live: without a new action for this long the device comes to rest, s.
    """

    socket: str | None = None
    device: str = ""
    time_to_live: float = 0.2
