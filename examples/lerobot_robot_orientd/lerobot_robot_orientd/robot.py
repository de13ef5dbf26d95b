"""A device of orientd as a robot of LeRobot."""

import math
import time
from collections.abc import Sequence

from lerobot.processor import RobotAction, RobotObservation
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

import orientd
from lerobot_robot_orientd.config import OrientdConfig
from orientd import Playing, rotation
from orientd.errors import RequestError, StateError

POSE = ("ee.x", "ee.y", "ee.z", "ee.wx", "ee.wy", "ee.wz")
"""Position in m and rotation vector in rad, in the world, as LeRobot names them."""

AGE = "ee.age"


class Orientd(Robot):
    """Moves the tool of one device.  Actions and observations are poses."""

    config_class = OrientdConfig
    name = "orientd"

    def __init__(self, config: OrientdConfig) -> None:
        super().__init__(config)
        self.config = config
        self._robot: orientd.Robot | None = None
        self._play: Playing | None = None

    @property
    def action_features(self) -> dict[str, type]:
        """Names and types of the entries of an action: a pose."""
        return dict.fromkeys(POSE, float)

    @property
    def observation_features(self) -> dict[str, type]:
        """Names and types of the entries of an observation: a pose and its age in s."""
        return dict.fromkeys((*POSE, AGE), float)

    @property
    def is_connected(self) -> bool:
        """Whether the daemon is connected: true until :meth:`disconnect`, also after a stop."""
        return self._play is not None

    @property
    def is_calibrated(self) -> bool:
        """Always true: the driver knows its device."""
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing: the daemon's configuration has the settings."""

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - LeRobot's argument
        """Connect to the daemon and take the lease of the device.

        Raises:
            OrientdError: there is no daemon, or the device cannot follow.
        """
        robot = orientd.connect(self.config.socket, holder="LeRobot")
        try:
            self._play = robot.play(device=self.config.device)
        except BaseException:
            robot.close()
            raise
        self._robot = robot

    @check_if_not_connected
    def disconnect(self) -> None:
        """Bring the device to rest and disconnect."""
        play, robot = self._play, self._robot
        self._play = self._robot = None
        try:
            play.close()
        finally:
            robot.close()

    @check_if_not_connected
    def get_observation(self) -> RobotObservation:
        """Return the newest measured pose and its age.

        Raises:
            StateError: the device has reported none yet.
            OrientdError: the daemon is lost.
        """
        devices = self._robot.state().devices
        device = devices[self.config.device] if self.config.device else next(iter(devices.values()))
        if not device.HasField("feedback_age"):
            raise StateError(f"no measurement of {device.name!r} yet")
        q, place = device.cycle.feedback_q, device.cycle.feedback_position
        vector = rotation.log([q.w, q.x, q.y, q.z]).tolist()
        numbers = (place.x, place.y, place.z, *vector, device.feedback_age)
        return dict(zip((*POSE, AGE), numbers, strict=True))

    @check_if_not_connected
    def send_action(self, action: RobotAction) -> RobotAction:
        """Send one pose as the target; return it.

        The device follows within its limits, and is there one period of the loop later.  It comes
        to rest if no action follows within the time to live.

        Raises:
            RequestError: a number of the pose is not finite.
            OrientdError: the device follows no more.
        """
        x, y, z, *vector = pose = [float(action[name]) for name in POSE]
        for name, number in zip(POSE, pose, strict=True):
            if not math.isfinite(number):
                problem = f"expected a finite number, got {number}; leave out this action"
                raise RequestError(name, problem)
        self._play.aim(
            {"rotation_vector": vector},
            position=(x, y, z),
            time_ns=time.monotonic_ns() + round(1e9 / self.config.fps),
            time_to_live=self.config.time_to_live,
        )
        return dict(zip(POSE, pose, strict=True))

    @check_if_not_connected
    def send_chunk(self, actions: Sequence[RobotAction], rate: float) -> None:
        """Send a whole chunk of a policy: *rate* poses a second, the first one period from now.

        Raises:
            RequestError: the chunk is not well formed.
            OrientdError: the device follows no more.
        """
        rows = [[float(action[name]) for name in POSE] for action in actions]
        self._play.chunk(
            [{"rotation_vector": row[3:]} for row in rows],
            rate=rate,
            positions=[row[:3] for row in rows],
        )
