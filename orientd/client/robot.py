"""The Python client: ``with orientd.connect() as robot: robot.move(...)``.

The client talks to the daemon over its control socket and holds the lease while it commands.  What
goes wrong is raised as the exception that the daemon raised.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, Unpack

from orientd.client.channel import Way
from orientd.client.connection import Connection, StartAt
from orientd.client.leases import Leases
from orientd.client.stop_call import ask_to_stop
from orientd.errors import OrientdError, RequestError
from orientd.protocol import CellReport
from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    from orientd.client.endless_turn import EndlessTurn
    from orientd.client.motion_request import RequestFields
    from orientd.client.move_handle import MoveHandle
    from orientd.client.observer import Observer
    from orientd.client.playing import Playing
    from orientd.client.teaching import Teaching
    from orientd.client.tracking import Tracking
    from orientd.planner import MotionRequest
    from orientd.stream import Cycle


COMMAND_TIMEOUT = 65.0
"""How long a command may take, s; the daemon gives up waiting for a device sooner."""

_REPORT_TIMEOUT = 1.0
"""How long the daemon may take to say how devices are that are stopped already, s."""


def _stopped_message(met: Mapping[str, Any]) -> pb.DeviceReport:
    """Return what little is known of a device that was stopped while the daemon says nothing."""
    return pb.DeviceReport(
        name=met["name"],
        state=f"STATE_{met['state']}",
        motion_number=met["motion"],
    )


def after_stop(connection: Connection, device: str) -> list[pb.DeviceReport]:
    """Return how a device is that was stopped, or all of them if *device* is empty.

    Raises:
        OrientdError: the daemon does not say so in time.
    """
    request = pb.GetStateRequest(device=device)
    now = connection.call(connection.stub.GetState, request, timeout=_REPORT_TIMEOUT)
    return list(now.devices)


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
        socket: where it listens; by default ``$ORIENTD_SOCKET``, or the user's runtime directory.
        address: ``HOST:PORT`` for TLS, or ``fleet:NAME`` in a cell; by default
            ``$ORIENTD_ADDRESS`` unless *socket* is given.
        certificate: who this client is, a file; by default ``$ORIENTD_CERT``.
        key: of that certificate, a file; by default ``$ORIENTD_KEY``.
        ca: who has signed the daemon's certificate, a file; by default ``$ORIENTD_CA``.
        holder: what others are told when they are refused because of this client.
        beside: whether to command beside other programs of the same user, on purpose; by default
            whether ``$ORIENTD_LEASE`` is set.  Each has a lease of its own, and ends its own
            motions alone by giving it back.
        lease: no longer used: say *beside*.
        timeout: how long the daemon may take to answer a command, s.  Planning has no limit.

    Raises:
        DaemonError: no daemon answers there, or not to this certificate.
        AccessError: it does not let this user do anything.
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
    except OrientdError:
        robot.close()
        raise
    return robot


class Robot:
    """A connection to the daemon; a context manager that gives everything back at its end.

    A motion that still runs then is stopped on its path: it belongs to the lease.

    ``device`` may be left out wherever the daemon has one device only.
    """

    def __init__(
        self, way: Way, *, holder: str = "", beside: bool = False, timeout: float = 30.0
    ) -> None:
        """Prepare to talk to the daemon at the end of *way*; see :func:`connect`.

        Args:
            way: to the daemon.
            holder: what others are told.
            beside: whether to command beside other programs of the same user.
            timeout: how long an answer may take, s.
        """
        self.socket = way.socket
        program = Path(sys.argv[0]).name or "python"
        self.holder = holder = holder or f"{program}, process {os.getpid()}"
        self._connection = Connection(way, timeout=timeout)
        self._stub = self._connection.stub
        self._leases = Leases(self._connection, holder=holder, beside=beside)
        self._moves: list[MoveHandle] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the leases back, which stops what still runs under them, and hang up."""
        self._leases.release()
        for move in self._moves:
            move.abandon()
        self._moves.clear()
        self._connection.close()

    # What there is

    def state(self) -> CellReport:
        """Return the daemon and its devices as they are now."""
        answer = self._connection.ask(self._stub.GetState, pb.GetStateRequest())
        return CellReport(answer.daemon, {device.name: device for device in answer.devices})

    def watch(
        self, device: str = "", *, rate_hz: float = 20.0, decimation: int = 1
    ) -> Iterator[list[Cycle]]:
        """Yield the cycles of a device in batches, as they happen, for as long as wanted.

        Args:
            device: its name.
            rate_hz: batches a second, 0.1 to 100.
            decimation: one cycle in so many is yielded.

        Raises:
            UnknownNameError: there is no such device.
            DaemonError: the daemon is lost.
        """
        with contextlib.closing(self.observe()) as observer:
            for cycles, _ in observer.sight(device, rate_hz=rate_hz, with_outline=False):
                yield [cycle for cycle in cycles if cycle.index % decimation == 0]

    def observe(self) -> Observer:
        """Return what watches every cycle and event, for recorders and viewers."""
        from orientd.client.observer import Observer

        return Observer(self._connection)

    def methods(self) -> list[pb.Method]:
        """Return the families of curves that motions can be made of."""
        answer = self._connection.ask(self._stub.ListMethods, pb.ListMethodsRequest())
        return list(answer.methods)

    def devices(self) -> list[pb.Device]:
        """Return the devices of the daemon's configuration."""
        answer = self._connection.ask(self._stub.ListDevices, pb.ListDevicesRequest())
        return list(answer.devices)

    # Commands

    @property
    def local_socket(self) -> Path | None:
        """The daemon's socket; ``None`` where it is asked by another way."""
        way = self._connection.way
        return None if way.address else way.socket

    def stop(self, device: str = "") -> list[pb.DeviceReport]:
        """Bring a device, or all of them, to rest on the path.  Needs no lease.

        On the daemon's own machine this needs the daemon's answer neither, which is told of
        afterwards: where it hangs, what is returned says little more than what was stopped.

        Raises:
            AccessError: this user is not admitted.
            DaemonError: a servo does not answer, or nobody does.
        """
        return self._rest("stop", device)

    def halt(self, device: str = "") -> list[pb.DeviceReport]:
        """Bring a device, or all of them, to rest as quickly as the limits allow.

        That may leave the path.  As for :meth:`stop`.
        """
        return self._rest("halt", device)

    def _rest(self, kind: str, device: str) -> list[pb.DeviceReport]:
        connection, local = self._connection, self.local_socket
        met = None if local is None else ask_to_stop(local, kind, device)
        if met is None:
            method = self._stub.Stop if kind == "stop" else self._stub.Halt
            request = pb.StopRequest(device=device, caller=self.holder)
            return list(connection.ask(method, request).devices)
        try:
            return after_stop(connection, device)
        except OrientdError:
            return [_stopped_message(one) for one in met]

    def pause(self, device: str = "") -> pb.DeviceReport:
        """Come to rest on the path, to be resumed."""
        return self._command(self._stub.Pause, device)

    def resume(self, device: str = "") -> pb.DeviceReport:
        """Go on with a paused motion."""
        return self._command(self._stub.Resume, device)

    def set_speed(self, speed: float, device: str = "") -> pb.DeviceReport:
        """Run motions at *speed*, above 0 and at most 1 as planned, now and from now on."""
        return self._command(self._stub.SetSpeed, device, pb.SetSpeedRequest, speed=speed)

    def enable(self, device: str = "") -> pb.DeviceReport:
        """Make a device follow; it does not move by this."""
        return self._command(self._stub.Enable, device)

    def disable(self, device: str = "", *, by_hand: bool = False) -> pb.DeviceReport:
        """Leave a device at rest, no longer following.

        Args:
            device: its name.
            by_hand: whether it may then be moved by hand, until it is enabled or disabled again or
                the lease runs out: an arm in freedrive, a gimbal without torque.
        """
        return self._command(self._stub.Disable, device, pb.DisableRequest, by_hand=by_hand)

    def reset(self, device: str = "") -> pb.DeviceReport:
        """Clear a fault, which may take seconds; starts the servo anew if it has ended."""
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
        """The token of the only lease that is held; empty before the first command."""
        return self._leases.token()

    def holds_lease(self, device: str = "") -> bool:
        """Return whether a lease of *device* is held."""
        return self._leases.is_held(device)

    def acquire_lease(self, *devices: str, beside: bool = False) -> None:
        """Take the lease of *devices* now, rather than with the first command to each.

        Args:
            devices: all of them, or none; every device of the daemon if none are named.
            beside: whether to command beside other programs of the same user, which keep their
                leases.  A program that gives its lease back, or loses it, ends its own motions
                alone.

        Raises:
            LeaseError: somebody else holds one of them.
        """
        names = devices or tuple(self.state().devices)
        missing = [name for name in names if not self._leases.is_held(name)]
        if missing:
            self._leases.acquire(missing, beside=beside)

    def release_lease(self) -> None:
        """Give the leases back now, rather than at the end; motions under them are stopped."""
        self._leases.release()

    def seize_lease(self, reason: str, *devices: str) -> None:
        """Take the lease whoever holds it; motions that run under it are stopped.

        Args:
            reason: why; it is recorded, and shown to whoever runs a motion.
            devices: of which; every device of the daemon if none are named.

        Raises:
            AccessError: that is for administrators.
        """
        self._leases.seize(reason, devices)

    # Motions

    def plan(
        self,
        keyframes: Iterable[object] | MotionRequest,
        *,
        device: str = "",
        sample_rate_hz: float = 0.0,
        plan_timeout: float | None = None,
        **fields: Unpack[RequestFields],
    ) -> pb.Plan:
        """Plan a motion without running it.

        It begins where the device is commanded to be, or will be once its present motion has ended.

        Args:
            keyframes: see :func:`~orientd.client.motion_request.motion_request`.
            device: what is to move.
            sample_rate_hz: how often to sample the motion for :func:`orientd.samples`, up to the
                device's own rate; 0 for not at all.
            plan_timeout: how long planning may take, s; by default, and at the most, as long as
                the daemon's settings allow.
            fields: see :class:`~orientd.client.motion_request.RequestFields`.

        Raises:
            RequestError: the motion is not well formed.
            StateError: the device is not at rest, ready to move.
            PlanError: it cannot be planned, or would break a limit.
        """
        from orientd.client.motion_request import motion_request, plan_seconds
        from orientd.protocol import from_request

        request = pb.PlanRequest(
            device=device,
            motion=from_request(motion_request(keyframes, **fields)),
            sample_rate_hz=sample_rate_hz,
            plan_timeout=plan_seconds(plan_timeout),
        )
        plan: pb.Plan = self._connection.call(self._stub.Plan, request).plan
        return plan

    def planned(
        self, motion_id: str = "", *, device: str = "", sample_rate_hz: float = 0.0
    ) -> pb.Plan | None:
        """Return the plan of a motion, whoever commanded it; ``None`` before the first.

        Args:
            motion_id: of a plan that is kept, or of the newest motion; empty for the latter.
            device: what moves.
            sample_rate_hz: as for :meth:`plan`.

        Raises:
            UnknownNameError: there is no such plan, or no longer.
        """
        request = pb.GetPlanRequest(
            device=device, motion_id=motion_id, sample_rate_hz=sample_rate_hz
        )
        answer = self._connection.ask(self._stub.GetPlan, request)
        return answer.plan if answer.HasField("plan") else None

    def move(
        self,
        keyframes: Iterable[object] | MotionRequest | pb.Plan,
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

        A motion that runs already is replaced from a point a little ahead of where it is, without
        a step in orientation, velocity or acceleration; or, with *queue*, followed.

        Args:
            keyframes: see :func:`~orientd.client.motion_request.motion_request`; or what
                :meth:`plan` returned, if the device is where that begins.
            device: what is to move.
            progress_rate_hz: reports a second, 0.1 to 100.
            queue: whether to follow what runs, rather than to replace it.
            blend_tolerance: for a queued motion, how far it may pass from the corner to the motion
                before it, rad, so that the device need not come to rest there.
            start_time: when to begin, seconds since the epoch as of :func:`time.time`; of motions
                with the same start time each is as far along its path as the others.
            on_target: what must be measured for the motion to count as done.
            plan_timeout: as for :meth:`plan`.
            fields: see :class:`~orientd.client.motion_request.RequestFields`.

        Raises:
            RequestError: the motion is not well formed.
            LeaseError: somebody else holds the lease.
            StateError: the device is not at rest, ready to move.
            PlanError: it cannot be planned, or would break a limit.
        """
        from orientd.client.motion_request import motion_request, plan_seconds
        from orientd.client.move_handle import MoveHandle
        from orientd.protocol import from_request

        request = pb.MoveRequest(
            device=device,
            progress_rate_hz=progress_rate_hz,
            plan_timeout=plan_seconds(plan_timeout),
        )
        if isinstance(keyframes, pb.Plan):
            request.motion_id = keyframes.motion_id
        else:
            request.motion.CopyFrom(from_request(motion_request(keyframes, **fields)))
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
        handle = MoveHandle(
            self._connection.call(self._stub.Move, request),
            explain=self._connection.explain,
            armed_by=armed_by,
            stop=lambda number: self._connection.ask(
                self._stub.Stop,
                pb.StopRequest(device=device, caller=self.holder, motion_number=number),
            ),
        )
        if handle.lease is not None:
            self._leases.keep(handle.lease)
        self._moves = [move for move in self._moves if not move.is_done]
        self._moves.append(handle)
        return handle

    def home(self, device: str = "") -> MoveHandle:
        """Bring the axes of a gimbal home, unwinding them; raises as :meth:`move`."""
        anywhere = {"quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}}
        return self.move([anywhere], device=device, device_options={"home": True}, name="home")

    def turn(self, rate: Sequence[float], duration: float, **fields: Any) -> MoveHandle:  # noqa: ANN401 - as of move
        """Turn at *rate*, rad/s, for *duration* s, from rest to rest; raises as :meth:`move`."""
        return self.move([], rate=rate, duration=duration, **fields)

    def turn_endlessly(self, rate: Sequence[float], **fields: Any) -> EndlessTurn:  # noqa: ANN401
        """Turn at *rate*, rad/s, until stopped or this client ends; raises as :meth:`move`."""
        from orientd.client.endless_turn import EndlessTurn

        return EndlessTurn(self, rate, **fields)

    def teach(self, *, device: str = "", by_hand: bool = True) -> Teaching:
        """Let a device be moved by hand, and take poses of it as keyframes; a context manager.

        An arm is in freedrive meanwhile, a gimbal without torque.

        Args:
            device: which one; it must be at rest.
            by_hand: without it nothing changes, and poses are taken wherever the device is brought
                otherwise; that needs no lease.

        Raises:
            LeaseError: somebody else holds the lease.
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
        report_rate_hz: float = 20.0,
    ) -> Tracking:
        """Have a device follow targets, which the :class:`Tracking` that is returned takes.

        Args:
            device: what is to move; at rest or in motion.
            limits: narrower than the device's own, as for a motion.
            report_rate_hz: reports a second, 0.1 to 100.

        Raises:
            LeaseError: another user holds the lease.
            StateError: the device cannot follow targets.
        """
        from orientd.client.tracking import Tracking

        return Tracking(self._connection, self._track_start(device, limits, report_rate_hz))

    def play(
        self,
        *,
        device: str = "",
        limits: Mapping[str, float | Sequence[float]] | None = None,
        report_rate_hz: float = 50.0,
    ) -> Playing:
        """Have a device play chunks of poses, which the :class:`Playing` that is returned takes.

        Args:
            device: what is to move; at rest or in motion.
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
        from orientd.protocol import limits_message

        start = pb.TrackStart(device=device, report_rate_hz=report_rate_hz)
        if limits is not None:
            start.limits.CopyFrom(limits_message(limits))
        start.lease_token = self._leases.needed(device)
        return start
