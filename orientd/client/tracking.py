"""The client's side of a Track call: hand targets over, hear how the following goes."""

from __future__ import annotations

import queue
import sys
import threading
from typing import Literal, Self, get_args

import grpc

from orientd.client.connection import Connection
from orientd.client.motion_request import keyframe_mappings
from orientd.driver import Quaternion as Orientation
from orientd.driver import Vector3
from orientd.errors import OrientdError, RequestError
from orientd.model import FORMS, joined, read_keyframe
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion
from orientd.rotation import Quaternion
from orientd.spelling import did_you_mean

Frame = Literal["body", "world"]

TARGET_KEYS = ("angular_velocity", "velocity_frame", "time_ns", "time_to_live", "position")
"""What a target may say beside its orientation."""


class Tracking:
    """A device that follows targets; a context manager that brings it to rest at its end."""

    def __init__(self, connection: Connection, begin: pb.TrackStart) -> None:
        """Begin to follow, and wait for the first report.

        Args:
            connection: to the daemon.
            begin: the first message.

        Raises:
            OrientdError: it was refused.
        """
        self._connection = connection
        self._outgoing: queue.SimpleQueue[pb.TrackRequest | None] = queue.SimpleQueue()
        self._outgoing.put(pb.TrackRequest(start=begin))
        outgoing = iter(self._outgoing.get, None)
        self._stream = connection.call(connection.stub.Track, outgoing)
        self._error: OrientdError | None = None
        self._ended = threading.Event()
        try:
            self._report: pb.TrackResponse = next(iter(self._stream))
        except grpc.RpcError as error:
            raise connection.explain(error) from error
        self._reader = threading.Thread(target=self._read, name="orientd track", daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def report(self) -> pb.TrackResponse:
        """The newest report."""
        return self._report

    def aim(
        self,
        target: object,
        *,
        angular_velocity: Vector3 | None = None,
        velocity_frame: Frame = "body",
        time_ns: int = 0,
        time_to_live: float = 0.0,
        position: Vector3 | None = None,
    ) -> None:
        """Hand a target over; returns at once.

        Args:
            target: a ``Rotation`` of SciPy, a :class:`~orientd.Quaternion`, or a mapping with an
                orientation as in a motion file.
            angular_velocity: of the target there, rad/s; zero if it stands still, ``None`` for as
                the targets up to now tell.
            velocity_frame: the frame of that.
            time_ns: when the target is there, on the monotonic clock of the daemon's machine
                (:func:`time.monotonic_ns`); 0 for when the message arrives.
            time_to_live: how long after that it counts, s; 0 for half a second.
            position: where it is there, m; ``None`` for a position that comes to rest.

        Raises:
            RequestError: the target is not well formed.
            OrientdError: the following has ended.
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

    def hand_over(self, message: pb.TrackTarget) -> None:
        """Hand a target over that :func:`target_message` made; returns at once.

        Raises:
            OrientdError: the following has ended.
        """
        self.send(pb.TrackRequest(target=message))

    def send(self, request: pb.TrackRequest) -> None:
        """Send a message of the call; returns at once.

        Raises:
            OrientdError: the following has ended.
        """
        self.raise_if_ended()
        self._outgoing.put(request)

    def raise_if_ended(self) -> None:
        """Raise the error that has ended the following, if it has ended.

        Raises:
            OrientdError: it has.
        """
        if self._ended.is_set():
            raise self._error or OrientdError("the device follows targets no more")

    def close(self, timeout: float = 10.0) -> None:
        """Give no more targets, and wait until the device has come to rest.

        Raises:
            OrientdError: something else had ended it.
        """
        self._outgoing.put(None)
        if not self._ended.wait(timeout):
            self._stream.cancel()
        self._reader.join()
        # An error on the way out of a block must not hide the one that led there.
        if self._error is not None and sys.exc_info()[0] is None:
            raise self._error

    def _read(self) -> None:
        try:
            for message in self._stream:
                self._report = message
        except grpc.RpcError as error:
            self._error = self._connection.explain(error)
        finally:
            self._ended.set()


def target_message(
    target: object,
    *,
    angular_velocity: Vector3 | None = None,
    velocity_frame: Frame = "body",
    time_ns: int = 0,
    time_to_live: float = 0.0,
    position: Vector3 | None = None,
) -> pb.TrackTarget:
    """Return a target as a message; see :meth:`Tracking.aim`.

    Raises:
        RequestError: the target is not well formed.
    """
    if velocity_frame not in get_args(Frame):
        raise RequestError(
            "target.velocity_frame", f"expected 'body' or 'world', got {velocity_frame!r}"
        )
    if not isinstance(time_ns, int):
        raise RequestError("target.time_ns", f"expected a whole number, got {time_ns!r}")
    if not isinstance(time_to_live, int | float):
        raise RequestError("target.time_to_live", f"expected a number, got {time_to_live!r}")
    message = pb.TrackTarget(time_ns=time_ns, time_to_live=time_to_live)
    message.orientation.CopyFrom(quaternion(orientation_of(target)))
    if angular_velocity is not None:
        message.angular_velocity.CopyFrom(_vector("angular_velocity", angular_velocity))
        message.velocity_frame = pb.FRAME_WORLD if velocity_frame == "world" else pb.FRAME_BODY
    if position is not None:
        message.position.CopyFrom(_vector("position", position))
    return message


def _vector(name: str, given: object) -> pb.Vector3:
    try:
        x, y, z = map(float, given)  # type: ignore[call-overload] # whatever came
    except (TypeError, ValueError):
        raise RequestError(f"target.{name}", f"expected three numbers, got {given!r}") from None
    return pb.Vector3(x=x, y=y, z=z)


def orientation_of(target: object, place: str = "target") -> Orientation:
    """Return the quaternion ``(w, x, y, z)`` of an orientation in any form.

    Args:
        target: a ``Rotation`` of SciPy, a :class:`~orientd.Quaternion`, or a mapping with an
            orientation as in a motion file.
        place: what messages call it.

    Raises:
        RequestError: it is none of these.
    """
    if isinstance(target, Quaternion):
        return (float(target.w), float(target.x), float(target.y), float(target.z))
    mapping = keyframe_mappings([target])[0]
    for key in sorted(set(mapping) - set(FORMS)):
        if key in TARGET_KEYS:
            raise RequestError(f"{place}.{key}", "expected next to the orientation, not among it")
        near = did_you_mean(key, [*FORMS, *TARGET_KEYS])
        raise RequestError(place, f"unknown key {key!r}{near}")
    try:
        return read_keyframe(mapping).q
    except RequestError as error:
        raise RequestError(joined(place, error.field), error.problem) from None
