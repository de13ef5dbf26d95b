"""The Python client: ``with orientd.connect() as robot: robot.move(...)``.

The client talks to the daemon over its control socket and holds the lease while it commands.  What
goes wrong is raised as the exception that the daemon raised.
"""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, Unpack

import grpc

from orientd.errors import OrientdError, RequestError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.channel import Way
from orientd.rpc.commands import Commands
from orientd.rpc.connection import Connection, StartAt
from orientd.rpc.descriptions import DeviceDescription, MethodDescription
from orientd.rpc.observer import Observer
from orientd.rpc.reports import CellReport, OnTarget, Plan
from orientd.rpc.wire import (
    configured_from_message,
    cycle_from_message,
    daemon_from_message,
    device_from_message,
    method_from_message,
)
from orientd.stream import Cycle

if TYPE_CHECKING:
    from orientd.endless_turn import EndlessTurn
    from orientd.planner import MotionRequest
    from orientd.rpc.motion_request import RequestFields
    from orientd.rpc.move_handle import MoveHandle
    from orientd.rpc.tracking import Tracking
    from orientd.teaching import Teaching


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
    return connect_by(way, holder=holder, beside=beside, timeout=timeout)


def connect_by(way: Way, *, holder: str, beside: bool = False, timeout: float) -> Robot:
    """Connect to the daemon at the end of *way*; see :func:`connect`."""
    program = Path(sys.argv[0]).name or "python"
    holder = holder or f"{program}, process {os.getpid()}"
    robot = Robot(way, holder=holder, beside=beside, timeout=timeout)
    try:
        robot.state()
    except OrientdError:
        robot.close()
        raise
    return robot


class Robot(Commands):
    """A connection to the daemon; a context manager that gives everything back at its end.

    A motion that still runs then is stopped on its path: it belongs to the lease.

    ``device`` may be left out wherever the daemon has one device only.
    """

    def __init__(self, way: Way, *, holder: str, beside: bool = False, timeout: float) -> None:
        """Prepare to talk to the daemon at the end of *way*; see :func:`connect`.

        Args:
            way: to the daemon.
            holder: what others are told.
            beside: whether to command beside other programs of the same user.
            timeout: how long an answer may take, s.
        """
        super().__init__(Connection(way, timeout=timeout), holder=holder, beside=beside)
        self.socket = way.socket
        self._moves: list[MoveHandle] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the leases back, which stops what still runs under them, and hang up."""
        self.release_lease()
        for move in self._moves:
            move.abandon()
        self._moves.clear()
        self._connection.close()

    # What there is

    def state(self) -> CellReport:
        """Return the daemon and its devices as they are now."""
        answer = self._connection.ask(self._stub.GetState, pb.GetStateRequest())
        reports = [device_from_message(device) for device in answer.devices]
        self._names = tuple(report.name for report in reports)
        return CellReport(
            daemon=daemon_from_message(answer.daemon),
            devices={report.name: report for report in reports},
        )

    def watch(
        self, device: str = "", *, rate_hz: float = 20.0, decimation: int = 1
    ) -> Iterator[list[Cycle]]:
        """Yield the cycles of a device in batches, as they happen, for as long as wanted.

        Args:
            device: its name.
            rate_hz: batches a second, 0.1 to 100.
            decimation: one cycle in so many is reported.

        Raises:
            UnknownNameError: there is no such device.
            DaemonError: the daemon is lost.
        """
        request = pb.WatchStateRequest(device=device, rate_hz=rate_hz, decimation=decimation)
        stream = self._connection.call(self._stub.WatchState, request)
        try:
            for batch in stream:
                yield [cycle_from_message(cycle) for cycle in batch.cycles]
        except grpc.RpcError as error:
            raise self._connection.explain(error) from error
        finally:
            stream.cancel()

    def observe(self) -> Observer:
        """Return what watches every cycle and event, for recorders and viewers."""
        return Observer(self._connection)

    def methods(self) -> list[MethodDescription]:
        """Return the families of curves that motions can be made of."""
        answer = self._connection.ask(self._stub.ListMethods, pb.ListMethodsRequest())
        return [method_from_message(method) for method in answer.methods]

    def devices(self) -> list[DeviceDescription]:
        """Return the devices of the daemon's configuration."""
        answer = self._connection.ask(self._stub.ListDevices, pb.ListDevicesRequest())
        return [configured_from_message(device) for device in answer.devices]

    # Motions

    def plan(
        self,
        keyframes: Iterable[object] | MotionRequest,
        *,
        device: str = "",
        sample_rate_hz: float = 0.0,
        plan_timeout: float | None = None,
        **fields: Unpack[RequestFields],
    ) -> Plan:
        """Plan a motion without running it.

        It begins where the device is commanded to be, or will be once its present motion has ended.

        Args:
            keyframes: see :func:`~orientd.rpc.motion_request.motion_request`.
            device: what is to move.
            sample_rate_hz: how often to sample the motion for :attr:`Plan.samples`, up to the
                device's own rate; 0 for not at all.
            plan_timeout: how long planning may take, s; by default, and at the most, as long as
                the daemon's settings allow.
            fields: see :class:`~orientd.rpc.motion_request.RequestFields`.

        Raises:
            RequestError: the motion is not well formed.
            StateError: the device is not at rest, ready to move.
            PlanError: it cannot be planned, or would break a limit.
        """
        from orientd.rpc.motion_request import motion_request, plan_seconds
        from orientd.rpc.wire import from_request, plan_from_message, samples_from_messages

        request = pb.PlanRequest(
            device=device,
            motion=from_request(motion_request(keyframes, **fields)),
            sample_rate_hz=sample_rate_hz,
            plan_timeout=plan_seconds(plan_timeout),
        )
        answer = self._connection.call(self._stub.Plan, request)
        samples = samples_from_messages(answer.samples) if sample_rate_hz else None
        return plan_from_message(answer.plan, samples=samples)

    def planned(
        self, motion_id: str = "", *, device: str = "", sample_rate_hz: float = 0.0
    ) -> Plan | None:
        """Return the plan of a motion, whoever commanded it; ``None`` before the first.

        Args:
            motion_id: of a plan that is kept, or of the newest motion; empty for the latter.
            device: what moves.
            sample_rate_hz: as for :meth:`plan`.

        Raises:
            UnknownNameError: there is no such plan, or no longer.
        """
        from orientd.rpc.wire import plan_from_message, samples_from_messages

        request = pb.GetPlanRequest(
            device=device, motion_id=motion_id, sample_rate_hz=sample_rate_hz
        )
        answer = self._connection.ask(self._stub.GetPlan, request)
        if not answer.HasField("plan"):
            return None
        samples = samples_from_messages(answer.samples) if sample_rate_hz else None
        return plan_from_message(answer.plan, samples=samples)

    def move(
        self,
        keyframes: Iterable[object] | MotionRequest | Plan,
        *,
        device: str = "",
        progress_rate_hz: float = 20.0,
        queue: bool = False,
        blend_tolerance: float = 0.0,
        start_time: float | StartAt | None = None,
        on_target: OnTarget | None = None,
        plan_timeout: float | None = None,
        **fields: Unpack[RequestFields],
    ) -> MoveHandle:
        """Plan a motion, start it, and return once it has begun.

        A motion that runs already is replaced from a point a little ahead of where it is, without
        a step in orientation, velocity or acceleration; or, with *queue*, followed.

        Args:
            keyframes: see :func:`~orientd.rpc.motion_request.motion_request`; or what
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
            fields: see :class:`~orientd.rpc.motion_request.RequestFields`.

        Raises:
            RequestError: the motion is not well formed.
            LeaseError: somebody else holds the lease.
            StateError: the device is not at rest, ready to move.
            PlanError: it cannot be planned, or would break a limit.
        """
        from orientd.rpc.motion_request import motion_request, plan_seconds
        from orientd.rpc.move_handle import MoveHandle
        from orientd.rpc.wire import from_request

        request = pb.MoveRequest(
            device=device,
            progress_rate_hz=progress_rate_hz,
            plan_timeout=plan_seconds(plan_timeout),
        )
        if isinstance(keyframes, Plan):
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
            request.on_target.CopyFrom(pb.OnTarget(**asdict(on_target)))

        def begin(token: str, number: int) -> Any:  # noqa: ANN401 - gRPC's
            request.lease_token, request.lease_sequence = token, number
            return self._connection.call(self._stub.Move, request)

        self._moves = [move for move in self._moves if not move.is_done]
        handle = MoveHandle(
            self._command_of(device, begin),
            explain=self._connection.explain,
            armed_by=armed_by,
            stop=lambda number: self._connection.ask(
                self._stub.Stop,
                pb.StopRequest(device=device, caller=self.holder, motion_number=number),
            ),
        )
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
        from orientd.endless_turn import EndlessTurn

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
        from orientd.teaching import Teaching

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
            LeaseError: somebody else holds the lease.
            StateError: the device cannot follow targets.
        """
        from orientd.rpc.tracking import Tracking
        from orientd.rpc.wire import limits_message

        start = pb.TrackStart(device=device, report_rate_hz=report_rate_hz)
        if limits is not None:
            start.limits.CopyFrom(limits_message(limits))

        def begin(token: str, number: int) -> None:
            start.lease_token, start.lease_sequence = token, number

        self._command_of(device, begin)
        return Tracking(self._connection, start)
