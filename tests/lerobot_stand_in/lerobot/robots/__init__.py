"""Robots and their configurations, which LeRobot finds by their type."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar


@dataclass(kw_only=True)
class RobotConfig:
    """Configuration of a robot."""

    id: str | None = None
    calibration_dir: Path | None = None
    choices: ClassVar[dict[str, type]] = {}

    @classmethod
    def register_subclass(cls, name):
        """Return a decorator that makes a configuration known by *name*."""

        def register(choice):
            cls.choices[name] = choice
            choice.type = name
            return choice

        return register

    @classmethod
    def get_choice_class(cls, name):
        """Return the configuration with a name."""
        return cls.choices[name]


class Robot:
    """A robot, which is connected as a context manager."""

    def __init__(self, config):
        self.robot_type, self.id = self.name, config.id

    def __enter__(self):
        self.connect()
        return self

    def __exit__(self, *_):
        self.disconnect()
