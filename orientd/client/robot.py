"""The Python client: ``with orientd.connect() as robot: robot.move(...)``.

The client talks to the daemon over its control socket and holds the lease while it commands.  It
raises the daemon's errors as the same exceptions.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, SupportsFloat, Unpack

from orientd.client.channel import Way
from orientd.client.connection import Connection, StartAt
from orientd.client.leases import Leases
from orientd.client.stop_call import ask_to_stop
from orientd.errors import OrientdError, RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import CellReport

if TYPE_CHECKING:
    from orientd.client.daemon_clock import Offset
    from orientd.client.endless_turn import EndlessTurn
    from orientd.client.motion_text import Keyframes, MotionText, RequestFields
    from orientd.client.move_handle import MoveHandle
    from orientd.client.observer import Observer
    from orientd.client.playing import Playing
    from orientd.client.teaching import Teaching
    from orientd.client.tracking import Tracking
    from orientd.stream.records import Cycle


COMMAND_TIMEOUT = 65.0
"""Timeout of a command, s; the daemon gives up waiting for a device sooner."""


def connect(
    socket: str | Path | None = None,
    *,
    address: str | None = None,
    certificate: str | Path | None = None,
    key: str | Path | None = None,
    ca: str | Path | None = None,
    holder: str = "",
    beside: bool | None = None,
    lease: str | None = None,
    timeout: float = 30.0,
) -> Robot:
    """Connect to the daemon.

    Args:
        socket: path of its socket; by default ``$ORIENTD_SOCKET``, or the user's runtime directory.
        address: ``HOST:PORT`` for TLS, or ``fleet:NAME`` in a cell; by default
            ``$ORIENTD_ADDRESS`` unless *socket* is given.
        certificate: file with the client certificate; by default ``$ORIENTD_CERT``.
        key: file with its private key; by default ``$ORIENTD_KEY``.
        ca: file with the CA that signed the daemon's certificate; by default ``$ORIENTD_CA``.
        holder: name shown to other clients that are refused because of this one.
        beside: whether to command together with other programs of the same user; by default whether
            ``$ORIENTD_LEASE`` is set.  Each has its own lease, and ends only its own motions when
            it releases that.
        lease: no longer used; use ``beside``.
        timeout: s for the answer to a command.  Planning has no limit.

    Raises:
        DaemonError: no daemon answers there, or it refuses this certificate.
        AccessError: it does not admit this user.
    """
    way = Way.find(socket, address, certificate, key, ca)
    if lease is not None:
        warnings.warn("connect(lease=) is beside= now", DeprecationWarning, stacklevel=2)
        beside = bool(lease) if beside is None else beside
    if beside is None:
        beside = bool(os.environ.get("ORIENTD_LEASE"))
    robot = Robot(way, holder=holder, beside=beside, timeout=timeout)
    try:
        robot.state()
        if way.address:
            _ = robot.clock_offset
    except OrientdError:
        robot.close()
        raise
    return robot


class Robot:
    """A connection to the daemon; a context manager that releases everything at its end.

    Leaving it waits for the running motions and the queued ones.  An exception, such as that of
    Ctrl-C, and :meth:`close` stop them on their paths, because they belong to the lease.

    ``device`` is optional if the daemon has only one device.
    """

    def __init__(
        self, way: Way, *, holder: str = "", beside: bool = False, timeout: float = 30.0
    ) -> None:
        """Prepare a connection to the daemon at *way*; see :func:`connect`.

        Args:
            way: endpoint of the daemon.
            holder: name shown to other clients.
            beside: whether to command together with other programs of the same user.
            timeout: s for an answer.
        """
        self.socket = way.socket
        program = Path(sys.argv[0]).name or "python"
        self.holder = holder = holder or f"{program}, process {os.getpid()}"
        self._connection = Connection(way, timeout=timeout)
        self._stub = self._connection.stub
        self._leases = Leases(self._connection, holder=holder, beside=beside)
        self._moves: list[MoveHandle] = []
        self._moves_lock = threading.Lock()
        self._stops: Counter[str] = Counter()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Wait for the motions unless an exception ends the block; then close everything.

        Raises:
            MotionStopped: another client stopped one, and nothing has waited for it.
            MotionFault: a fault ended one, and nothing has waited for it.
            StateError: one does not end by itself soon, so it is stopped on its path.
        """
        try:
            if kind is None:
                self._await_moves()
        finally:
            self.close()

    def _await_moves(self) -> None:
        with self._moves_lock:
            moves = [move for move in self._moves if not move.is_told]
        if any(not move.is_done for move in moves):
            devices = self.state().devices
            paused = [name for name, report in devices.items() if report.is_paused]
            for move in moves:
                move.check_ends(paused)
        for move in moves:
            move.wait(check=not move.is_cancelled)

    def close(self) -> None:
        """Release the leases, which stops the motions under them, and close the connection."""
        with contextlib.suppress(OrientdError):
            self._leases.release()
        with self._moves_lock:
            moves, self._moves = self._moves, []
        for move in moves:
            move.abandon()
        self._connection.close()

    # What there is

    def state(self) -> CellReport:
        """Return the current state of the daemon and its devices."""
        answer = self._connection.ask(self._stub.GetState, pb.GetStateRequest())
        return CellReport(answer.daemon, {device.name: device for device in answer.devices})

    @property
    def clock_offset(self) -> Offset:
        """How far the daemon's monotonic clock is ahead of this process's, with its bound.

        It is exactly 0 on the daemon's own machine.  Otherwise :func:`connect` measures it, and a
        session measures it again every minute.  Sessions of targets and chunks convert the stamps
        that you give, which are of :func:`time.monotonic` here.  Reports and cycles have stamps of
        the daemon.

        Raises:
            OrientdError: the daemon does not answer.
        """
        return self._connection.clock.offset()

    def watch(
        self, device: str = "", *, rate_hz: float = 20.0, decimation: int = 1
    ) -> Iterator[list[Cycle]]:
        """Yield the cycles of a device in batches, as they happen.

        Args:
            device: its name.
            rate_hz: batches a second, 0.1 to 100.
            decimation: yield one cycle in this many.

        Raises:
            UnknownNameError: the device does not exist.
            DaemonError: the daemon is lost.
        """
        with contextlib.closing(self.observe()) as observer:
            for cycles, _ in observer.sight(device, rate_hz=rate_hz, with_outline=False):
                yield [cycle for cycle in cycles if cycle.index % decimation == 0]

    def observe(self) -> Observer:
        """Return an observer of every cycle and event, for recorders and viewers."""
        from orientd.client.observer import Observer

        return Observer(self._connection)

    def methods(self) -> list[pb.Method]:
        """Return the interpolation methods."""
        answer = self._connection.ask(self._stub.ListMethods, pb.ListMethodsRequest())
        return list(answer.methods)

    def devices(self) -> list[pb.Device]:
        """Return the devices of the daemon's configuration."""
        answer = self._connection.ask(self._stub.ListDevices, pb.ListDevicesRequest())
        return list(answer.devices)

    # Commands

    @property
    def local_socket(self) -> Path | None:
        """The daemon's socket; ``None`` for another kind of endpoint."""
        way = self._connection.way
        return None if way.address else way.socket

    def stop(self, device: str = "") -> list[pb.DeviceReport]:
        """Stop a device, or all of them, on the path.  Needs no lease.

        On the daemon's own machine the stop does not need the daemon, which is only asked for a
        report afterwards.  If it hangs, the result has little more than the names of the stopped
        devices.

        Raises:
            AccessError: this user is not admitted.
            DaemonError: a servo does not answer, or no daemon does.
        """
        return self._rest("stop", device)

    def halt(self, device: str = "") -> list[pb.DeviceReport]:
        """Stop a device, or all of them, as fast as the limits allow.

        The device may leave the path.  See :meth:`stop`.
        """
        return self._rest("halt", device)

    def _rest(self, kind: str, device: str) -> list[pb.DeviceReport]:
        connection, local = self._connection, self.local_socket
        self._stops[device] += 1
        with self._moves_lock:
            for move in self._moves:
                move.is_cancelled |= not device or move.device in ("", device)
        met = None if local is None else ask_to_stop(local, kind, device)
        if met is None:
            method = self._stub.Stop if kind == "stop" else self._stub.Halt
            request = pb.StopRequest(device=device, caller=self.holder)
            return list(connection.ask(method, request).devices)
        try:
            return connection.after_stop(device)
        except OrientdError:
            # The little that the servos tell.
            known = ((one["name"], f"STATE_{one['state']}", one["motion"]) for one in met)
            return [
                pb.DeviceReport(name=name, state=state, motion_number=number)
                for name, state, number in known
            ]

    def _stops_of(self, device: str) -> int:
        """Return how often this client has stopped a device; any device for an empty name."""
        stops = list(self._stops.items())  # another thread may stop a device meanwhile
        return sum(count for name, count in stops if not device or name in ("", device))

    def pause(self, device: str = "") -> pb.DeviceReport:
        """Come to rest on the path; :meth:`resume` continues."""
        return self._command(self._stub.Pause, device)

    def resume(self, device: str = "") -> pb.DeviceReport:
        """Resume a paused motion."""
        return self._command(self._stub.Resume, device)

    def set_speed(self, speed: float, device: str = "") -> pb.DeviceReport:
        """Run motions at *speed* from now on: above 0, and at most 1, which is as planned.

        Raises:
            RequestError: *speed* is not such a number.
        """
        if not isinstance(speed, SupportsFloat):
            raise RequestError("speed", f"expected more than 0 and at most 1, got {speed!r}")
        return self._command(self._stub.SetSpeed, device, pb.SetSpeedRequest, speed=speed)

    def enable(self, device: str = "") -> pb.DeviceReport:
        """Enable a device so that it follows setpoints; it does not move."""
        return self._command(self._stub.Enable, device)

    def disable(self, device: str = "", *, by_hand: bool = False) -> pb.DeviceReport:
        """Disable a device at rest, so that it no longer follows setpoints.

        Args:
            device: its name.
            by_hand: whether it may then be moved by hand, until it is enabled or disabled again or
                the lease expires: an arm in freedrive, a gimbal without torque.
        """
        return self._command(self._stub.Disable, device, pb.DisableRequest, by_hand=by_hand)

    def reset(self, device: str = "") -> pb.DeviceReport:
        """Clear a fault, which may take seconds; restart the servo if it has ended."""
        return self._command(self._stub.Reset, device)

    def _command(
        self,
        method: Callable[..., Any],
        device: str,
        request: Callable[..., Any] = pb.CommandRequest,
        **more: Any,  # noqa: ANN401
    ) -> pb.DeviceReport:
        message = request(lease_token=self._leases.needed(device), device=device, **more)
        answer = self._connection.call(method, message, timeout=COMMAND_TIMEOUT)
        report: pb.DeviceReport = answer.device
        return report

    # Leases

    @property
    def lease_token(self) -> str:
        """The token of the only held lease; empty before the first command."""
        return self._leases.token()

    def holds_lease(self, device: str = "") -> bool:
        """Return whether a lease of *device* is held."""
        return self._leases.is_held(device)

    def acquire_lease(self, *devices: str, beside: bool = False) -> None:
        """Acquire the lease of *devices* now, rather than with the first command to each.

        Args:
            devices: names of devices; by default every device of the daemon.
            beside: whether to command together with other programs of the same user, which keep
                their leases.  A program that releases its lease, or loses it, ends only its own
                motions.

        Raises:
            LeaseError: another client holds one of them.
        """
        names = devices or tuple(self.state().devices)
        missing = [name for name in names if not self._leases.is_held(name)]
        if missing:
            self._leases.acquire(missing, beside=beside)

    def release_lease(self, *devices: str) -> None:
        """Release leases now, rather than at the end; motions under them are stopped.

        Args:
            devices: names of devices; by default every device whose lease is held.

        Raises:
            DaemonError: the daemon, or the servo of a motion that this stops, does not answer.
        """
        self._leases.release(devices)

    def seize_lease(self, reason: str, *devices: str) -> None:
        """Seize the lease from its holder; motions that run under it are stopped.

        Args:
            reason: recorded, and shown to the owner of a running motion.
            devices: names of devices; by default every device of the daemon.

        Raises:
            AccessError: only administrators may do that.
            DaemonError: the servo of a motion that this stops does not answer.  Then no client has
                the lease.
        """
        self._leases.seize(reason, devices)

    # Motions

    def plan(
        self,
        keyframes: Keyframes | MotionText,
        *,
        device: str = "",
        sample_rate_hz: float = 0.0,
        plan_timeout: float | None = None,
        **fields: Unpack[RequestFields],
    ) -> pb.Plan:
        """Plan a motion without running it.

        It begins at the commanded state of the device, or at the end of its current motion.

        Args:
            keyframes: see :func:`~orientd.client.motion_text.motion_text`.
            device: name of the device.
            sample_rate_hz: rate of the samples for :func:`orientd.samples`, up to the device's own
                rate; 0 for none.
            plan_timeout: s for planning; by default, and at most, the daemon's setting.
            fields: see :class:`~orientd.client.motion_text.RequestFields`.

        Raises:
            RequestError: the motion is malformed.
            StateError: the device is not at rest and ready to move.
            PlanError: it cannot be planned, or would break a limit.
        """
        from orientd.client.motion_text import motion_text, plan_seconds

        motion = motion_text(keyframes, **fields)
        request = pb.PlanRequest(
            device=device,
            motion=motion.text,
            source=motion.source,
            columns=motion.columns,
            sample_rate_hz=sample_rate_hz,
            plan_timeout=plan_seconds(plan_timeout),
        )
        with self._connection.naming_versions():
            plan: pb.Plan = self._connection.call(self._stub.Plan, request).plan
        return plan

    def planned(
        self, motion_id: str = "", *, device: str = "", sample_rate_hz: float = 0.0
    ) -> pb.Plan | None:
        """Return the plan of a motion of any client; ``None`` before the first.

        Args:
            motion_id: identifier of a stored plan; empty for that of the newest motion.
            device: name of the device.
            sample_rate_hz: as for :meth:`plan`.

        Raises:
            UnknownNameError: the plan does not exist, or is no longer stored.
        """
        request = pb.GetPlanRequest(
            device=device, motion_id=motion_id, sample_rate_hz=sample_rate_hz
        )
        answer = self._connection.ask(self._stub.GetPlan, request)
        return answer.plan if answer.HasField("plan") else None

    def move(
        self,
        keyframes: Keyframes | MotionText | pb.Plan,
        *,
        device: str = "",
        progress_rate_hz: float = 20.0,
        queue: bool = False,
        blend_tolerance: float = 0.0,
        start_time: float | StartAt | None = None,
        on_target: pb.OnTarget | None = None,
        plan_timeout: float | None = None,
        **fields: Unpack[RequestFields],
    ) -> MoveHandle:
        """Plan a motion, start it, and return once it has begun.

        It replaces a running motion from a point slightly ahead, without a step in orientation,
        velocity or acceleration.  With *queue* it follows that motion instead.

        Args:
            keyframes: see :func:`~orientd.client.motion_text.motion_text`; or a result of
                :meth:`plan`, if the device is at its start.
            device: name of the device.
            progress_rate_hz: reports a second, 0.1 to 100.
            queue: whether to follow the running motion rather than replace it.
            blend_tolerance: for a queued motion, largest angle by which the device may cut the
                corner to it and leave both motions, rad.  If it stops there all the same, a note
                of the plan says why.
            start_time: start in Unix time in s, as of :func:`time.time`; motions with the
                same start time stay in step.
            on_target: required measurement for the motion to count as done.
            plan_timeout: as for :meth:`plan`.
            fields: see :class:`~orientd.client.motion_text.RequestFields`.

        Raises:
            RequestError: the motion is malformed.
            LeaseError: another client holds the lease.
            StateError: the device is not at rest and ready to move, or was stopped before the
                motion began.
            PlanError: it cannot be planned, or would break a limit.
        """
        from orientd.client.motion_text import motion_text, plan_seconds
        from orientd.client.move_handle import MoveHandle

        stops = self._stops_of(device)
        for name, number, step in (
            ("progress_rate_hz", progress_rate_hz, "give reports a second, 0.1 to 100"),
            ("blend_tolerance", blend_tolerance, "give an angle in rad, or 0 for no blend"),
        ):
            if not isinstance(number, SupportsFloat):
                raise RequestError(name, f"expected a number, got {number!r}; {step}")
        request = pb.MoveRequest(
            device=device,
            progress_rate_hz=progress_rate_hz,
            plan_timeout=plan_seconds(plan_timeout),
        )
        if isinstance(keyframes, pb.Plan):
            request.motion_id = keyframes.motion_id
        else:
            request.motion, request.source, request.columns = motion_text(keyframes, **fields)
        request.queue, request.blend_tolerance = queue, blend_tolerance
        armed_by: float | None = None
        if isinstance(start_time, StartAt):
            request.start_ns, armed_by = start_time.monotonic_ns, start_time.armed_by
        elif start_time is not None:
            if not isinstance(start_time, int | float) or not math.isfinite(start_time):
                raise RequestError("start_time", f"expected seconds, got {start_time!r}")
            request.start_time.FromNanoseconds(round(start_time * 1e9))
        if on_target is not None:
            request.on_target.CopyFrom(on_target)

        request.lease_token = self._leases.token(device)
        if not request.lease_token:
            # The call takes the lease by itself.
            request.holder, request.beside = self.holder, self._leases.beside
        if self._stops_of(device) != stops:
            # The daemon only knows of motions that it has been asked for.
            raise StateError("stopped by this client before the motion was asked for")
        with self._connection.naming_versions():
            handle = MoveHandle(
                self._connection.call(self._stub.Move, request),
                explain=self._connection.explain,
                device=device,
                has_start_time=start_time is not None,
                armed_by=armed_by,
                stop=lambda number: self._connection.ask(
                    self._stub.Stop,
                    pb.StopRequest(device=device, caller=self.holder, motion_number=number),
                ),
            )
        if handle.lease is not None:
            self._leases.keep(handle.lease)
        with self._moves_lock:
            self._moves = [*(move for move in self._moves if not move.is_done), handle]
        if self._stops_of(device) != stops:
            handle.cancel()  # the request may have been on its way
        return handle

    def home(self, device: str = "") -> MoveHandle:
        """Move every gimbal axis to zero, unwinding its turns; errors as for :meth:`move`."""
        anywhere = {"quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}}
        return self.move([anywhere], device=device, device_options={"home": True}, name="home")

    def turn(self, rate: Sequence[float], duration: float, **fields: Any) -> MoveHandle:  # noqa: ANN401 - as of move
        """Turn at *rate*, rad/s, for *duration* s, rest to rest; errors as for :meth:`move`."""
        return self.move([], rate=rate, duration=duration, **fields)

    def turn_endlessly(self, rate: Sequence[float], **fields: Any) -> EndlessTurn:  # noqa: ANN401
        """Turn at *rate*, rad/s, until stopped or this client ends; errors as for :meth:`move`."""
        from orientd.client.endless_turn import EndlessTurn

        return EndlessTurn(self, rate, **fields)

    def teach(self, *, device: str = "", by_hand: bool = True) -> Teaching:
        """Let a device be moved by hand, and record its poses as keyframes; a context manager.

        Meanwhile an arm is in freedrive, and a gimbal without torque.

        Args:
            device: name of the device, which must be at rest.
            by_hand: if false, nothing changes, and poses are recorded while the device moves in
                another way. That needs no lease.

        Raises:
            LeaseError: another client holds the lease.
            StateError: the device moves, or is in a fault.
            OrientdError: it cannot be moved by hand.
        """
        from orientd.client.teaching import Teaching

        return Teaching(self, device, by_hand=by_hand)

    def track(
        self,
        *,
        device: str = "",
        limits: Mapping[str, float | Sequence[float]] | None = None,
        path_tolerance: float | None = None,
        report_rate_hz: float = 20.0,
    ) -> Tracking:
        """Make a device follow targets, which you send to the returned :class:`Tracking`.

        Args:
            device: name of the device; at rest or in motion.
            limits: narrower than the device's own, as for a motion.
            path_tolerance: how far the tool of an arm may leave the straight line to a target at
                rest, m.  The arm stops there, until another target comes.  ``None`` for no bound.
            report_rate_hz: reports a second, 0.1 to 100.

        Raises:
            RequestError: the tolerance is not above 0, or a limit is none.
            LeaseError: another user holds the lease.
            StateError: the device cannot follow targets.
        """
        from orientd.client.tracking import Tracking

        start = self._track_start(device, limits, report_rate_hz)
        if path_tolerance is not None:
            if not 0.0 < path_tolerance < math.inf:
                problem = (
                    f"expected more than 0 m, got {path_tolerance!r}; leave it out for no bound"
                )
                raise RequestError("path_tolerance", problem)
            start.path_tolerance = path_tolerance
        return Tracking(self._connection, start)

    def play(
        self,
        *,
        device: str = "",
        limits: Mapping[str, float | Sequence[float]] | None = None,
        report_rate_hz: float = 50.0,
    ) -> Playing:
        """Make a device play chunks of poses, which you send to the returned :class:`Playing`.

        Args:
            device: name of the device; at rest or in motion.
            limits: narrower than the device's own, as for a motion.
            report_rate_hz: reports a second, 0.1 to 100.

        Raises:
            LeaseError: another user holds the lease.
            StateError: the device cannot follow poses.
        """
        from orientd.client.playing import Playing

        return Playing(self._connection, self._track_start(device, limits, report_rate_hz))

    def _track_start(
        self,
        device: str,
        limits: Mapping[str, float | Sequence[float]] | None,
        report_rate_hz: float,
    ) -> pb.TrackStart:
        from orientd.protocol.limits import limits_message

        start = pb.TrackStart(device=device, report_rate_hz=report_rate_hz)
        if limits is not None:
            start.limits.CopyFrom(limits_message(limits))
        start.lease_token = self._leases.needed(device)
        return start
