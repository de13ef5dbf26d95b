"""What the daemon reports to its clients, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from orientd.driver import Quaternion, Vector3
from orientd.errors import Fault
from orientd.stream import Cycle, ServoState

if TYPE_CHECKING:
    from orientd.planner import Certificate, Limits
    from orientd.rotation import Floats
    from orientd.rpc.descriptions import PartReport

STALE = 1.0
"""s; what is older is no longer shown as what is."""


def titled(number: int, name: str) -> str:
    """Return what to call a motion: its number, and its name where it has one.

    >>> titled(3, ""), titled(3, "pick")
    ('3', "3 'pick'")
    """
    return f"{number} {name!r}" if name else str(number)


class Outcome(Enum):
    """How a motion ended.

    ``done`` is said of what arrived, ``passed`` of what was blended into the motion after it.
    """

    DONE = "done"
    PASSED = "passed"
    STOPPED = "stopped"
    FAULT = "fault"
    REPLACED = "replaced"
    UNSETTLED = "unsettled"

    @property
    def is_as_asked(self) -> bool:
        """Whether the motion went as it was asked for."""
        return self in (Outcome.DONE, Outcome.PASSED)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A planned motion at many instants.

    Attributes:
        times: s from the beginning of the motion, shape ``(n,)``.
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        omega_body: angular velocities, rad/s, shape ``(n, 3)``.
        alpha_body: their derivatives, rad/s^2, shape ``(n, 3)``.
        position: of the tool in the world, m, shape ``(n, 3)``.
        velocity: their derivatives, m/s, shape ``(n, 3)``.
    """

    times: Floats
    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats


@dataclass(frozen=True, slots=True)
class Plan:
    """A planned motion.

    Attributes:
        motion_id: names it for a move.
        duration: from rest to rest, s.
        start_time: when the first keyframe is reached, s from the beginning.
        end_time: when the last keyframe is reached.
        keyframe_times: when each of them is reached.
        certificate: what was computed of it before any of it is sent.
        samples: the motion itself, where it was asked for.
        name: what its request calls it; empty where it does not.
        planning: s that this took from the request's arrival on; 0 in what is not a plan's answer.
    """

    motion_id: str
    duration: float
    start_time: float
    end_time: float
    keyframe_times: tuple[float, ...]
    certificate: Certificate
    samples: Samples | None = None
    name: str = ""
    planning: float = 0.0


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a motion is.

    Attributes:
        path_time: s from the beginning of the motion.
        duration: the whole of it, s.
        state: what the servo is doing.
        is_paused: whether it stands, or comes to stand, on its path.
        speed: rate of the time scaling; 1 is as planned.
        q: orientation sent last, ``(w, x, y, z)``.
        omega_body: angular velocity sent last, rad/s.
        position: position sent last, m.
        lateness: the largest one of the cycles since the report before, s.
        tracking_error: angle between what was sent and reported, rad; ``None`` without feedback.
        overruns: cycles of this motion so far that began more than half a period late.
    """

    path_time: float
    duration: float
    state: ServoState
    is_paused: bool
    speed: float
    q: Quaternion
    omega_body: Vector3
    position: Vector3
    lateness: float
    tracking_error: float | None
    overruns: int


@dataclass(frozen=True, slots=True)
class Durations:
    """How long something took or how late it was, over many cycles; s.

    Attributes:
        p50: half the cycles were no worse than this.
        p99: 99 percent of them.
        p99_9: 99.9 percent of them.
        largest: none was worse.
    """

    p50: float
    p99: float
    p99_9: float
    largest: float


@dataclass(frozen=True, slots=True)
class Statistics:
    """What was measured of a motion, all of it from what was sent.

    Attributes:
        cycles: setpoints sent.
        overruns: cycles that began more than half a period late.
        missed: deadlines that were left out altogether.
        stalls: times that it went on from rest, after its process had not run for a while.
        lateness: how late the cycles began.
        work: how long they worked.
        velocity: largest backward difference of the orientations sent, rad/s.
        acceleration: largest second difference, rad/s^2.
        jerk: largest third difference, rad/s^3.
        path_error: largest angle between what was sent and the planned path, rad.
        tracking_error: largest angle between what was sent and what was reported, rad.
        start_velocity_error: velocity sent at the first keyframe against what was asked, rad/s;
            ``None`` where none was asked for, or it was not passed at full speed.
        end_velocity_error: the same at the last keyframe.
    """

    cycles: int
    overruns: int
    missed: int
    stalls: int
    lateness: Durations
    work: Durations
    velocity: float
    acceleration: float
    jerk: float
    path_error: float
    tracking_error: float
    start_velocity_error: float | None
    end_velocity_error: float | None


@dataclass(frozen=True, slots=True)
class Summary:
    """How a motion ended.

    Attributes:
        motion_number: 1 for the first motion of a device.
        outcome: in one word.
        text: why, where it was not run to its end.
        statistics: what was measured of it; ``None`` where the device has forgotten it.
        settled_after: how long after the last setpoint it had been on target for the settle time,
            s; ``None`` where that was not asked for, or did not come.
        start_lateness: how long after the start time that was asked for it began to be run, s;
            ``None`` where none was asked for.
        start_skew: s from the first to the last beginning of motions with that start time.
    """

    motion_number: int
    outcome: Outcome
    text: str
    statistics: Statistics | None
    settled_after: float | None = None
    start_lateness: float | None = None
    start_skew: float | None = None


@dataclass(frozen=True, slots=True)
class OnTarget:
    """When a motion counts as done: by what is measured, not by what was sent.

    Attributes:
        tolerance: largest angle between the measured orientation and the motion's last one, rad.
        rate: largest measured angular velocity, rad/s.
        settle_time: how long both must hold without a break, s.
        timeout: how long to wait for it after the last setpoint, s.
    """

    tolerance: float
    rate: float
    settle_time: float
    timeout: float = 5.0


@dataclass(frozen=True, slots=True)
class MoveTiming:
    """What passed before the first setpoint of a motion.

    Attributes:
        planning: s from the arrival of the request to the end of planning.
        splicing: s from there until the servo had taken the motion up.
        received_ns: when the request arrived, the daemon's monotonic clock.
        attempts: how often it was planned.
        waiting: s of planning spent on motions asked for before, a stop, a change of speed.
    """

    planning: float
    splicing: float
    received_ns: int
    attempts: int
    waiting: float = 0.0


@dataclass(frozen=True, slots=True)
class TrackReport:
    """How the following of targets goes.

    Attributes:
        state: what the servo is doing.
        q: orientation sent last.
        omega_body: angular velocity sent last, rad/s.
        time_ns: when that was due, the daemon's monotonic clock.
        targets: handed to the servo so far.
        left_out: those of them that it left out as older than the newest.
        refused: targets that were none.
        refusal: why the last of these was not.
        error: angle from what was sent last to the newest target, rad; ``None`` without one.
    """

    state: ServoState
    q: Quaternion
    omega_body: Vector3
    time_ns: int
    targets: int
    left_out: int
    refused: int
    refusal: str
    error: float | None


@dataclass(frozen=True, slots=True)
class DeviceReport:
    """A device as it is.

    Attributes:
        name: as in the configuration.
        driver: name of its driver.
        rate_hz: cycles a second.
        limits: what no motion of it may exceed.
        state: what its servo is doing.
        fault: why it is in the state ``FAULT``.
        fault_text: in words.
        is_paused: whether a motion is paused.
        speed: the speed that is set.
        motion_number: of the newest motion; 0 before the first.
        motion_id: of the newest motion.
        path_time: how far along it, s.
        duration: its length, s.
        servo_pid: process id of the servo; ``None`` where there is none.
        scheduling: what the operating system granted it.
        is_memory_locked: whether its memory cannot be paged out.
        cycle: the newest one; ``None`` before the first.
        lead: how long before its time each setpoint is sent, s; 0 for a device that is not led.
            What the newest cycle sent is where the device is to be a lead from now.
        phase: where in a period of the monotonic clock its cycles begin, as a share of it.
        motion_name: what the newest motion's request calls it; empty where it does not.
        is_free: whether it was let go, to be moved by hand.
        health: how its parts are, as last measured; empty where they do not tell.
        cycle_age: how long before this report the newest cycle was due, s; 0 before the first.
    """

    name: str
    driver: str
    rate_hz: float
    limits: Limits
    state: ServoState
    fault: Fault
    fault_text: str
    is_paused: bool
    speed: float
    motion_number: int
    motion_id: str
    path_time: float
    duration: float
    servo_pid: int | None
    scheduling: str
    is_memory_locked: bool
    cycle: Cycle | None
    lead: float = 0.0
    phase: float = 0.0
    motion_name: str = ""
    is_free: bool = False
    health: tuple[PartReport, ...] = ()
    cycle_age: float = 0.0

    @property
    def feedback_age(self) -> float | None:
        """How long before this report the device was measured, s; ``None`` where it never was."""
        cycle = self.cycle
        if cycle is None or not cycle.has_feedback:
            return None
        return self.cycle_age + cycle.feedback_age_ns * 1e-9

    @property
    def is_stale(self) -> bool:
        """Whether a servo runs of which nothing was heard for longer than :data:`STALE`."""
        return self.servo_pid is not None and self.cycle_age > STALE


@dataclass(frozen=True, slots=True)
class LeaseReport:
    """A lease, to those who do not hold it.

    Attributes:
        holder: who holds it, as they named themselves; empty when it is free.
        remaining: how long it lasts unless renewed, s.
        identity: whose it is as the daemon knows them, for example ``user:1000``.
        devices: that it is of.
    """

    holder: str
    remaining: float
    identity: str = ""
    devices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class DaemonReport:
    """The daemon as it is.

    Attributes:
        version: of orientd.
        pid: its process id.
        uptime: s since it started.
        socket: where it listens.
        configuration: path of its file; empty for the built-in one.
        lease_holder: who holds the first lease; empty when there is none.
        lease_remaining: how long that lasts unless renewed, s.
        lease_identity: whose it is as the daemon knows them, for example ``user:1000``.
        lease_devices: the devices that it is of.
        leases: all that are held.
    """

    version: str
    pid: int
    uptime: float
    socket: str
    configuration: str
    lease_holder: str
    lease_remaining: float
    lease_identity: str = ""
    lease_devices: tuple[str, ...] = ()
    leases: tuple[LeaseReport, ...] = ()

    def lease_of(self, device: str) -> LeaseReport:
        """Return the lease of *device*; one without a holder where that is free."""
        return next((one for one in self.leases if device in one.devices), LeaseReport("", 0.0))


@dataclass(frozen=True, slots=True)
class CellReport:
    """The daemon and its devices as they are.

    Attributes:
        daemon: the process, its socket and the lease.
        devices: by name.
    """

    daemon: DaemonReport
    devices: Mapping[str, DeviceReport]
