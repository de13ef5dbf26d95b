"""Run policies of diffusion_policy and UMI on orientd, through their controller of a UR arm.

It replaces ``RTDEInterpolationController`` of
https://github.com/real-stanford/diffusion_policy (``real_world/rtde_interpolation_controller.py``):
the same methods, shapes and units.  The daemon does the work of the original's own process.  In the
original the path is linear between waypoints, so its velocity has steps.  Here the acceleration is
continuous, and the motion keeps the limits of the device.

A pose is six numbers: position in m, then a rotation vector in rad.  Times are seconds of
:func:`time.time`.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any, Self, SupportsFloat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orientd import rotation
from orientd.client.playing import Playing
from orientd.client.robot import Robot, connect
from orientd.errors import OrientdError, RequestError, StateError
from orientd.rotation import Quaternion
from orientd.stream.records import CHUNK_POSES, Cycle

Floats = NDArray[np.float64]

CONTEXT = 4
"""Past waypoints that still shape the curve through the next ones."""

LONGEST_AWAY = 60.0
"""How far from now the time of a waypoint may be, s."""

WATCH_HZ = 100.0
"""Batches of states a second that the daemon sends."""

SLACK_NS = 1e6
"""Time by which a state may be early, ns: cycles are not exactly on time."""

KEYS = {
    "ActualTCPPose": 6,
    "ActualTCPSpeed": 6,
    "ActualQ": 6,
    "ActualQd": 6,
    "TargetTCPPose": 6,
    "TargetTCPSpeed": 6,
    "TargetQ": 6,
    "TargetQd": 6,
}
"""Entries of a state and their lengths; NaN if the device does not report the value."""


class RTDEInterpolationController:
    """Drive one device through waypoints; a context manager.

    Args:
        shm_manager: ignored; accepted so that existing calls work.
        robot_ip: ignored; the daemon's configuration has the address of the robot.
        frequency: states to keep per second.
        lookahead_time: ignored.
        gain: ignored.
        max_pos_speed: largest speed, m/s; ``None`` for that of the device.
        max_rot_speed: largest angular velocity, rad/s; ``None`` for that of the device.
        launch_timeout: how long :meth:`start_wait` waits for the first state, s.
        get_max_k: number of states to keep.
        receive_latency: age of a state on arrival, s; UMI subtracts it.
        device: name of the device; it may be empty if the daemon has only one.
        socket: of the daemon, as :func:`orientd.connect` takes it.
        settings: the other arguments of the original; ignored.

    Raises:
        RequestError: the frequency is not positive.
    """

    def __init__(
        self,
        shm_manager: object = None,
        robot_ip: str = "",
        frequency: float = 125.0,
        lookahead_time: float = 0.1,
        gain: float = 300.0,
        max_pos_speed: float | None = None,
        max_rot_speed: float | None = None,
        launch_timeout: float = 3.0,
        get_max_k: int = 128,
        *,
        receive_latency: float = 0.0,
        device: str = "",
        socket: str | Path | None = None,
        **settings: object,
    ) -> None:
        del shm_manager, robot_ip, lookahead_time, gain, settings
        if not isinstance(frequency, SupportsFloat) or not float(frequency) > 0.0:
            raise RequestError("frequency", f"expected more than 0, got {frequency!r}")
        self._speeds = {"linear_velocity": max_pos_speed, "velocity": max_rot_speed}
        self._launch_timeout, self._spacing_ns = launch_timeout, 1e9 / frequency
        self._receive_latency = receive_latency
        self._device, self._socket = device, socket
        self._states: deque[dict[str, Floats]] = deque(maxlen=get_max_k)
        self._waypoints: list[tuple[float, Floats]] = []
        self._ready, self._ending = threading.Event(), threading.Event()
        self._robot: Robot | None = None
        self._play: Playing | None = None

    # Life

    def start(self, wait: bool = True) -> None:
        """Connect to the daemon and begin; wait for the first state if *wait* is true.

        Raises:
            OrientdError: there is no daemon, or the device cannot follow.  It is disconnected then.
        """
        try:
            self._begin()
            if wait:
                self.start_wait()
        except BaseException:
            self.stop()
            raise

    def _begin(self) -> None:
        robot = self._robot = connect(self._socket, holder="RTDEInterpolationController")
        found = next((one for one in robot.devices() if self._device in ("", one.name)), None)
        if found is None:
            raise StateError(f"the daemon has no device {self._device!r}")
        self._device = found.name
        limits = {
            name: min(speed, getattr(found.limits, name))
            for name, speed in self._speeds.items()
            if speed is not None
        }
        self._play = robot.play(device=found.name, limits=limits or None)
        self._ending.clear()
        threading.Thread(target=self._watch, args=(robot,), daemon=True).start()

    def start_wait(self) -> None:
        """Wait for the first state.

        Raises:
            StateError: there is none within the launch timeout.
        """
        if not self._ready.wait(self._launch_timeout):
            raise StateError(f"no state of {self._device!r} within {self._launch_timeout:g} s")

    def stop(self, wait: bool = True) -> None:
        """Bring the device to rest and disconnect."""
        play, self._play = self._play, None
        if play is not None:
            play.close()
        if wait:
            self.stop_wait()

    def stop_wait(self) -> None:
        """Wait until the controller is disconnected."""
        self._ending.set()
        robot, self._robot = self._robot, None
        if robot is not None:
            robot.close()

    @property
    def is_ready(self) -> bool:
        """Whether there is a state."""
        return self._ready.is_set()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    # Commands

    def servoL(self, pose: ArrayLike, duration: float = 0.1) -> None:  # noqa: N802 - their name
        """Go to *pose*, shape ``(6,)``, within *duration* seconds, and drop later waypoints.

        Raises:
            ValueError: the pose has another shape or is not finite, or the duration is not positive
                or too long.
            OrientdError: the device no longer follows.
        """
        if not duration > 0.0:
            raise ValueError(f"duration must be positive, got {duration!r}")
        now = time.monotonic()
        self._waypoints = [one for one in self._waypoints if one[0] <= now]
        self._schedule(pose, now + duration)

    def schedule_waypoint(self, pose: ArrayLike, target_time: float) -> None:
        """Schedule *pose*, shape ``(6,)``, for *target_time*; later waypoints are dropped.

        Raises:
            ValueError: the pose has another shape or is not finite, the time is of another clock or
                too far ahead, or there are too many waypoints.
            OrientdError: the device no longer follows.
        """
        ahead = target_time - time.time()
        if not abs(ahead) <= LONGEST_AWAY:
            raise RequestError(
                "target_time",
                f"expected at most {LONGEST_AWAY:g} s from now by time.time(), "
                f"got {target_time!r}, now {time.time():.10g}; give time.time() plus a delay",
            )
        self._schedule(pose, ahead + time.monotonic())

    def _schedule(self, pose: ArrayLike, when: float) -> None:
        play = self._play
        if play is None:
            raise StateError("the controller is not started")
        row = np.asarray(pose, dtype=np.float64)
        if row.shape != (6,):
            raise ValueError(f"expected a pose of shape (6,), got {row.shape}")
        if not np.isfinite(row).all():
            raise RequestError("pose", f"expected finite numbers, got {row.tolist()}; leave it out")
        now = time.monotonic()
        passed = [one for one in self._waypoints if one[0] <= now]
        waiting = [one for one in self._waypoints if now < one[0] < when]
        waypoints = [*passed[-CONTEXT:], *waiting, (when, row)]
        if len(waypoints) > CHUNK_POSES:
            raise ValueError(f"at most {CHUNK_POSES - CONTEXT} waypoints may be ahead")
        rows = np.array([row for _, row in waypoints])
        quaternions = Quaternion.from_array(rotation.exp(rows[:, 3:]), order="wxyz")
        play.chunk(
            quaternions if isinstance(quaternions, list) else [quaternions],
            times=[when for when, _ in waypoints],
            positions=rows[:, :3],
        )
        self._waypoints = waypoints

    # States

    def get_state(self, k: int | None = None, out: object = None) -> dict[str, Any]:
        """Return the newest state, or the newest *k*, stacked.

        Returns:
            The entries of :data:`KEYS`, shape ``(6,)`` or ``(k, 6)``: poses, and velocities in the
            world, m/s and rad/s; joints in rad and rad/s.  ``robot_receive_timestamp`` is the time
            of each, and ``robot_timestamp`` that time without the receive latency.

        Raises:
            StateError: there is none yet.
        """
        del out
        states = self._kept()
        return dict(states[-1]) if k is None else _stacked(states[-k:])

    def get_all_state(self) -> dict[str, Any]:
        """Return all states that are kept, stacked; see :meth:`get_state`."""
        return _stacked(self._kept())

    def _kept(self) -> list[dict[str, Floats]]:
        states = list(self._states)
        if not states:
            raise StateError("there is no state yet; start() waits for the first")
        return states

    def _watch(self, robot: Robot) -> None:
        """Keep states until the connection ends."""
        next_ns = 0.0
        before: Cycle | None = None
        with contextlib.suppress(OrientdError):  # the next command says it
            for cycles in robot.watch(self._device, rate_hz=WATCH_HZ):
                for cycle in cycles:
                    if cycle.deadline_ns >= next_ns:
                        next_ns = cycle.deadline_ns + self._spacing_ns - SLACK_NS
                        state = _state(cycle, before)
                        received = state["robot_receive_timestamp"]
                        state["robot_timestamp"] = received - self._receive_latency
                        self._states.append(state)
                        before = cycle
                        self._ready.set()
                if self._ending.is_set():
                    return


def _state(cycle: Cycle, before: Cycle | None) -> dict[str, Floats]:
    """Return a cycle as a state; the cycle *before* gives the velocities that it does not have."""
    span = (cycle.deadline_ns - before.deadline_ns) * 1e-9 if before is not None else 1.0
    before = before or cycle

    def rate(name: str) -> Floats:
        now, then = getattr(cycle, name), getattr(before, name)
        return (np.array(now) - then) / span if len(now) == len(then) else np.full(len(now), np.nan)

    measured = rotation.rotate(cycle.feedback_q, np.array(cycle.feedback_omega_body))
    sent = rotation.rotate(cycle.q, np.array(cycle.omega_body))
    return {
        "ActualTCPPose": np.array([*cycle.feedback_position, *rotation.log(cycle.feedback_q)]),
        "ActualTCPSpeed": np.concatenate([rate("feedback_position"), measured]),
        "ActualQ": _joints(cycle.joints),
        "ActualQd": _joints(rate("joints")),
        "TargetTCPPose": np.array([*cycle.position, *rotation.log(cycle.q)]),
        "TargetTCPSpeed": np.concatenate([rate("position"), sent]),
        "TargetQ": _joints(cycle.sent_joints),
        "TargetQd": _joints(rate("sent_joints")),
        "robot_receive_timestamp": np.array(
            time.time() + 1e-9 * (cycle.deadline_ns - time.monotonic_ns())
        ),
    }


def _joints(angles: ArrayLike) -> Floats:
    row = np.full(KEYS["ActualQ"], np.nan)
    given = np.asarray(angles, dtype=np.float64)[: len(row)]
    row[: len(given)] = given
    return row


def _stacked(states: list[dict[str, Floats]]) -> dict[str, Any]:
    return {name: np.array([state[name] for state in states]) for name in states[0]}
