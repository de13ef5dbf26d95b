"""The client's side of a Track call: send targets, receive reports."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import grpc

from orientd.client.clutch import Anchor, Clutch
from orientd.client.connection import Connection
from orientd.client.pointing import Pointing
from orientd.client.target_messages import Frame, target_message
from orientd.errors import DaemonError, OrientdError
from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    from google.protobuf.message import Message
    from numpy.typing import ArrayLike


_SPACING = 0.001
"""Least time between two targets for their arrival, s: more of them would wait on the way."""


def paced(
    outgoing: queue.SimpleQueue[pb.TrackRequest | None], skip: Callable[[], object]
) -> Iterator[pb.TrackRequest]:
    """Yield messages as they come, up to ``None``.

    Of the targets without a time that come within :data:`_SPACING`, only the newest is sent.  They
    count from their arrival, so one that had waited would be wrong.

    Args:
        outgoing: the messages.
        skip: called for each target that is not sent.
    """
    message, due = outgoing.get(), 0.0
    while message is not None:
        left = due - time.monotonic()
        if not _is_for_arrival(message):
            yield message
            message = outgoing.get()
        elif left <= 0.0:
            yield message
            due = time.monotonic() + _SPACING
            message = outgoing.get()
        else:
            with suppress(queue.Empty):
                following = outgoing.get(timeout=left)
                if following is None or not _is_for_arrival(following):
                    yield message
                else:
                    skip()
                message = following


def _is_for_arrival(request: pb.TrackRequest) -> bool:
    """Return whether this is a target without a time."""
    return request.WhichOneof("what") == "target" and not request.target.time_ns


@dataclass(frozen=True, slots=True)
class TrackTiming:
    """Report how a device has followed the targets of a session so far.

    Attributes:
        targets: number of targets that the servo received.
        left_out: those of them that it skipped: expired, of an instant that had passed, or replaced
            by a newer one within a cycle.
        refused: targets and chunks that the daemon refused.
        refusal: why the last of them was refused, a pose skipped, or a chunk too late; empty for
            none.
        error: angle from the newest setpoint to the newest target at that time, rad; ``None``
            without a target.
        position_error: distance to its position, m; ``None`` if it has none.
        path_deviation: distance of an arm's tool from the straight line to a target at rest, m.
        largest_path_deviation: largest value of *path_deviation* so far, m.
    """

    targets: int
    left_out: int
    refused: int
    refusal: str
    error: float | None
    position_error: float | None
    path_deviation: float
    largest_path_deviation: float


def figures(message: Message, names: Iterable[str]) -> dict[str, Any]:
    """Return fields of a message by name; ``None`` for those that may be absent and are."""
    known = message.DESCRIPTOR.fields_by_name
    return {
        name: None
        if known[name].has_presence and not message.HasField(name)
        else getattr(message, name)
        for name in names
        if name in known
    }


class Tracking(Pointing):
    """A device that follows targets; a context manager that brings it to rest at its end."""

    def __init__(self, connection: Connection, begin: pb.TrackStart) -> None:
        """Start to follow, and wait for the first report.

        Args:
            connection: to the daemon.
            begin: the first message.

        Raises:
            OrientdError: it was refused.
        """
        super().__init__(connection, begin.device)
        self._offset_ns = connection.clock.offset().ns
        self._outgoing: queue.SimpleQueue[pb.TrackRequest | None] = queue.SimpleQueue()
        self._outgoing.put(pb.TrackRequest(start=begin))
        self._replaced = 0
        messages = paced(self._outgoing, self._skip)
        self._stream = connection.call(connection.stub.Track, messages)
        self._error: OrientdError | None = None
        self._ended = threading.Event()
        try:
            self._report: pb.TrackResponse = next(iter(self._stream))
        except BaseException as error:
            self._outgoing.put(None)  # ends gRPC's thread that sends
            self._stream.cancel()
            if isinstance(error, grpc.RpcError):
                raise connection.explain(error) from error
            raise
        self._anchor = Anchor(self._report)
        self._reader = threading.Thread(target=self._read, name="orientd track", daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def report(self) -> pb.TrackResponse:
        """The newest report.

        Its counts include the targets that were not sent because a newer one came within 1 ms.
        """
        return self._report

    def timing(self) -> TrackTiming:
        """Return how the device has followed the targets, from the newest report."""
        return TrackTiming(**figures(self.report, TrackTiming.__annotations__))

    def aim(
        self,
        target: object,
        *,
        angular_velocity: ArrayLike | None = None,
        velocity_frame: Frame = "body",
        time_ns: int = 0,
        time_to_live: float = 0.0,
        position: ArrayLike | None = None,
    ) -> None:
        """Send a target; returns at once.

        If targets without *time_ns* come faster than one a millisecond, only the newest is sent.

        Args:
            target: a ``Rotation`` of SciPy, a :class:`~orientd.Quaternion`, or a mapping with an
                orientation as in a motion file.
            angular_velocity: of the target, rad/s; zero if it stands still, ``None`` to derive it
                from earlier targets.
            velocity_frame: the frame of that velocity.
            time_ns: time of the target, :func:`time.monotonic_ns` of this machine; 0 for the
                arrival of the message.
            time_to_live: how long after that it counts, s; 0 for half a second.
            position: of the target, m; ``None`` for a position that comes to rest.

        Raises:
            RequestError: the target is malformed.
            OrientdError: tracking has ended.
        """
        self.hand_over(
            target_message(
                target,
                angular_velocity=angular_velocity,
                velocity_frame=velocity_frame,
                time_ns=time_ns,
                time_to_live=time_to_live,
                position=position,
            )
        )

    def engage(
        self,
        *,
        scale: float = 1.0,
        frame: Frame = "world",
        time_to_live: float = 0.2,
    ) -> Clutch:
        """Hold the clutch: a hand moves the device from where it is; see :class:`Clutch`.

        A device that moves comes to rest first, and follows the hand from there.

        Args:
            scale: how far the device turns and moves, relative to the hand.
            frame: the axes about which the device turns as the hand does: those of the world, or
                each of its own body.
            time_to_live: how long a pose of the hand counts, s.  Then the device comes to rest, so
                that it stops if the hand sends no more poses.

        Raises:
            RequestError: a setting is out of range.
        """
        return Clutch(self, self._anchor, scale=scale, frame=frame, time_to_live=time_to_live)

    def hand_over(self, message: pb.TrackTarget) -> None:
        """Send a target made by :func:`target_message`; returns at once.

        Its time is of this machine.

        Raises:
            OrientdError: tracking has ended.
        """
        self.send(pb.TrackRequest(target=message))

    def send(self, request: pb.TrackRequest) -> None:
        """Send a message of the call; returns at once.

        Times in it are of this machine.

        Raises:
            OrientdError: tracking has ended.
        """
        self.raise_if_ended()
        self._anchor.lose()
        self._outgoing.put(self._stamped(request))

    def _stamped(self, request: pb.TrackRequest) -> pb.TrackRequest:
        """Return a message with its times converted to the daemon's clock."""
        offset_ns = self._offset_ns
        if not offset_ns:
            return request
        stamped = pb.TrackRequest()
        stamped.CopyFrom(request)
        if stamped.target.time_ns:
            stamped.target.time_ns += offset_ns
        if stamped.chunk.observed_ns:
            stamped.chunk.observed_ns += offset_ns
        if stamped.chunk.times_ns:
            stamped.chunk.times_ns[:] = [time_ns + offset_ns for time_ns in request.chunk.times_ns]
        return stamped

    def raise_if_ended(self) -> None:
        """Raise the error that has ended tracking, if it has ended.

        Raises:
            OrientdError: it has.
        """
        if self._ended.is_set():
            why = self._report.ended
            problem = f"the device no longer follows targets{why and f': {why}'}"
            raise self._error or OrientdError(problem)

    def close(self, timeout: float = 10.0) -> None:
        """Send no more targets, and wait until the device has come to rest.

        Raises:
            DaemonError: the daemon did not report the rest in time.
            OrientdError: another error had ended it.
        """
        self._outgoing.put(None)
        if not self._ended.wait(timeout):
            self._stream.cancel()
            self._ended.wait()
            self._error = DaemonError(
                f"the daemon did not report that the device rests within {timeout:g} s; "
                "look at `orientd status`, and stop the device with `orientd stop`"
            )
        self._reader.join()
        # An error at the end of a block must not hide the original one.
        if self._error is not None and sys.exc_info()[0] is None:
            raise self._error

    def _skip(self) -> None:
        self._replaced += 1

    def _read(self) -> None:
        try:
            for message in self._stream:
                message.targets += self._replaced
                message.left_out += self._replaced
                self._report = message
                self._anchor.note(message)
                self._offset_ns = self._connection.clock.offset().ns
        except grpc.RpcError as error:
            lost = "lost the daemon; the device comes to rest"
            self._error = self._connection.explain(error, lost=lost)
        finally:
            self._outgoing.put(None)
            self._ended.set()
