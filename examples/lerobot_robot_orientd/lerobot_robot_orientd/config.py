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
        fps: actions a second of the loop.  An action is due one period after it is sent, when the
            next one comes, so that a late loop shows less in the motion.
        time_to_live: without a new action for this long the device comes to rest, s.
    """

    socket: str | None = None
    device: str = ""
    fps: float = 30.0
    time_to_live: float = 0.2

    def __post_init__(self) -> None:
        if not self.fps > 0.0:
            step = "give the rate of the loop"
            raise ValueError(f"fps: expected more than 0, got {self.fps}; {step}")
