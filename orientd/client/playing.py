"""Play the chunks of poses that a policy infers, while it infers the next ones."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, SupportsFloat, TypeGuard

import numpy as np

from orientd.client.smoothing import smoothed_orientations, smoothed_positions
from orientd.client.target_messages import CLOCK, Frame, is_in_world, orientation_of, vector_of
from orientd.client.tracking import Tracking, TrackTiming, figures
from orientd.driver import IDENTITY, Vector3
from orientd.driver import Quaternion as Orientation
from orientd.errors import RequestError, StateError
from orientd.floats import difference, norm
from orientd.model.plain import to_plain
from orientd.protocol import control_pb2 as pb
from orientd.protocol.targets import check_chunk_times, pose_problem, stamp_problem
from orientd.protocol.values import to_quaternion
from orientd.rotation import Quaternion, is_rotation
from orientd.stream.records import CHUNK_POSES
from orientd.tolerances import NORM_TOLERANCE

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_NONE: Orientation = (math.nan, math.nan, math.nan, math.nan)
"""A pose that the daemon skips and counts."""

MOST_RATE_HZ = 2000.0
"""Largest rate of the poses of a chunk: nearer ones are of one instant."""

LONGEST_SETTLING = 30.0
"""How long after the last pose is due a block waits for the device to rest there, s."""

_LOOK = 0.01
"""Seconds from one look at the newest report to the next."""


@dataclass(frozen=True, slots=True)
class PlayTiming(TrackTiming):
    """Report how the device has followed the chunks and targets of a session so far.

    In addition to the attributes of :class:`.TrackTiming`:

    Attributes:
        chunks: number of chunks that the servo received.
        live: poses of the newest one that were still in the future when the servo received it.
        stale: poses of all chunks that were in the past by then.
        skipped: poses that were not finite, not of unit norm, or out of reach.
        starved: chunks that came after the poses had run out, with poses to come or without.
        smoothed: chunks that were smoothed because their curve would break the limits.
        largest_smoothing: largest angle by which that turned a pose, rad.
        largest_position_smoothing: largest distance by which it moved one, m.
        largest_seam: largest angle by which a chunk contradicted the one before, rad.
        largest_position_seam: largest distance by which it did, m.
        behind: angle from the newest setpoint to the poses, rad, because of the limits.
        largest_behind: largest value of *behind* so far, rad.
        lag: delay behind the poses that fits the last second best, s; 0 if the limits allow all,
            or the poses stand still.
        position_behind: distance from the newest setpoint to the position of the poses, m, because
            of the limits.
        largest_position_behind: largest value of *position_behind* so far, m.
        position_lag: delay of the position behind the poses, as *lag* is that of the orientation.
        inference: longest time from the observation of a chunk until the call that sends it, s.  If
            a chunk names no observation, its first pose stands for it.
        longest_inference: largest *inference* of a chunk for which the poses do not run out, s:
            the least time from an observation to the end of the poses that were known before it.
            Infinite before the second chunk, unless all poses of the first one are late.
        latency_p50: time from the observation that a chunk names to the first setpoint that it
            shapes, s: half of the newest 256 such chunks took no longer; ``None`` before the first.
        latency_p95: the same for 95 of 100 of them, s.
    """

    chunks: int
    live: int
    stale: int
    skipped: int
    starved: int
    smoothed: int
    largest_smoothing: float
    largest_position_smoothing: float
    largest_seam: float
    largest_position_seam: float
    behind: float
    largest_behind: float
    lag: float
    position_behind: float
    largest_position_behind: float
    position_lag: float
    inference: float
    longest_inference: float
    latency_p50: float | None
    latency_p95: float | None


class Playing(Tracking):
    """Play chunks of poses on a device.

    A context manager: at its end it waits until the device has played the poses, except after an
    exception.  If the device does not rest within :data:`LONGEST_SETTLING` after the last pose is
    due, it is brought to rest where it is, and the block raises :class:`.StateError`.
    """

    _last_ns = 0
    _last_q = IDENTITY
    _inference = -math.inf
    _sent = 0

    def chunk(
        self,
        poses: Sequence[object],
        *,
        rate: float | None = None,
        start: float | None = None,
        times: ArrayLike | None = None,
        positions: ArrayLike | None = None,
        angular_velocities: ArrayLike | None = None,
        velocity_frame: Frame = "body",
        observed: float | None = None,
        tolerance: float = 0.0,
        position_tolerance: float = 0.0,
    ) -> None:
        """Send a chunk of poses, and return at once.

        It replaces all poses at and after the first of its own that is still in the future.  The
        daemon skips and counts late poses, and poses that are not finite, not of unit norm, or out
        of range or reach; see :meth:`timing`.  An event of the device tells the first of them.

        Args:
            poses: 1 to 256 orientations, each in a form that :meth:`.Robot.move` takes, or a
                ``Rotation`` of SciPy with as many rotations.  A mapping may have a ``position``.
            rate: poses a second, at most 2000.
            start: when the first pose is due, s, by :func:`time.monotonic` of this machine;
                ``None`` for one period of *rate* from now.
            times: when each pose is due, s, by that clock; in place of *rate* and *start*.  The
                first one that is not late is at most 10 s ahead, the last one 60 s.
            positions: position of each pose, shape ``(n, 3)``, m; ``None`` for those of the
                mappings, or for a position that comes to rest.
            angular_velocities: at each pose, shape ``(n, 3)``, rad/s; ``None`` to derive them from
                the poses.
            velocity_frame: frame of the angular velocities.
            observed: when the observation was made that the chunk answers, s, by that clock.  It
                counts for the latencies of :meth:`timing`; ``None`` for no such observation.
            tolerance: how far each orientation may be turned to smooth the chunk, rad.
            position_tolerance: how far each position may be moved for that, m.

        Raises:
            RequestError: the chunk is not well formed, its times are of another clock or too far
                ahead, or none of its poses is one.
            OrientdError: the device no longer plays.
        """
        is_world = is_in_world(velocity_frame)
        orientations, places = _poses(poses)
        count = len(orientations)
        if not 1 <= count <= CHUNK_POSES:
            step = "send them as several chunks, one behind another" if count else "send no chunk"
            problem = f"expected 1 to {CHUNK_POSES} poses, got {count}; {step}"
            raise RequestError("poses", problem)
        stamps = _stamps(count, rate, start, times)
        if positions is not None:
            if places:
                raise RequestError("positions", "given twice, in the poses too")
            places = _rows("positions", positions, len(orientations))
        for name, most in (("tolerance", tolerance), ("position_tolerance", position_tolerance)):
            if not 0.0 <= most < math.inf:
                raise RequestError(name, f"expected 0 or more, got {most!r}")
        if tolerance > 0.0 and angular_velocities is not None:
            raise RequestError("tolerance", "expected 0 with angular_velocities")
        if tolerance > 0.0 or position_tolerance > 0.0:
            orientations, places = _smoothed(
                stamps, orientations, places, tolerance, position_tolerance
            )
        message = pb.TrackChunk(times_ns=stamps)
        if observed is not None:
            message.observed_ns = _observed_ns(observed)
        message.orientations.extend(number for q in orientations for number in q)
        message.positions.extend(number for place in places for number in place)
        rows = []
        if angular_velocities is not None:
            rows = _rows("angular_velocities", angular_velocities, len(orientations))
            message.angular_velocities.extend(number for row in rows for number in row)
            message.velocity_frame = pb.FRAME_WORLD if is_world else pb.FRAME_BODY
        _check_poses(orientations, rows, places)
        self.send(pb.TrackRequest(chunk=message))
        self._sent += 1
        self._last_ns, self._last_q = max(zip(stamps, orientations, strict=True))
        now_ns = time.monotonic_ns()
        begin_ns = message.observed_ns or min(stamps)
        self._inference = max(self._inference, 1e-9 * (now_ns - begin_ns))

    def timing(self) -> PlayTiming:
        """Return how the device has followed the chunks, from the newest report."""
        of_chunks = figures(self.report.chunks, PlayTiming.__annotations__)
        longest = of_chunks.pop("longest_inference")
        return PlayTiming(
            **figures(self.report, TrackTiming.__annotations__),
            **of_chunks,
            inference=max(self._inference, 0.0),
            longest_inference=math.inf if longest is None else longest,
        )

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the poses have run out and the device rests; return whether it does.

        Args:
            timeout: how long to wait at most, s; ``None`` for :data:`LONGEST_SETTLING` after the
                last pose is due.

        Raises:
            OrientdError: the device no longer plays.
        """
        begin = time.monotonic()
        while not self._has_played():
            due = max(begin, 1e-9 * self._last_ns)
            if time.monotonic() > (due + LONGEST_SETTLING if timeout is None else begin + timeout):
                return False
            self.raise_if_ended()
            time.sleep(_LOOK)
        return True

    def _has_played(self) -> bool:
        report = self.report
        if not self._sent:
            return True
        if report.chunks.chunks + report.refused < self._sent:
            return False
        is_due = report.time_ns - self._offset_ns > self._last_ns or not report.chunks.chunks
        return is_due and self._anchor.rests

    def __exit__(self, *of: object) -> None:
        try:
            if of[0] is None and not self.wait():
                away = norm(difference(to_quaternion(self.report.q), self._last_q))
                raise StateError(
                    f"the device does not rest {LONGEST_SETTLING:g} s after the last pose was "
                    f"due, and is {away:.3g} rad away from it; widen the limits, or call "
                    "wait() before the end of the block"
                )
        finally:
            self.close()


def _poses(poses: Sequence[object]) -> tuple[list[Orientation], list[Vector3]]:
    """Return the orientations of *poses*, and their positions if all have one."""
    if is_rotation(poses):
        # SciPy's own order is scalar last.
        rows = poses.as_quat(canonical=False).tolist()  # type: ignore[attr-defined]
        rows = [rows] if poses.single else rows  # type: ignore[attr-defined]
        return [(w, x, y, z) for x, y, z, w in rows], []
    if isinstance(poses, Mapping | str) or not hasattr(poses, "__len__"):
        raise RequestError("poses", f"expected a sequence, got {type(poses).__name__}")
    orientations: list[Orientation] = []
    places: list[Vector3] = []
    for k, pose in enumerate(poses):
        turn = pose
        if isinstance(pose, Mapping) and "position" in pose:
            places.append(vector_of(pose["position"], f"poses[{k}].position"))
            turn = {key: entry for key, entry in pose.items() if key != "position"}
        if isinstance(turn, Mapping) and set(turn) == {"quaternion"}:
            turn = _components(turn["quaternion"]) or turn
        try:
            orientations.append(orientation_of(turn, f"poses[{k}]"))
        except RequestError:
            if not _is_no_pose(turn):
                raise
            orientations.append(_NONE)
    if places and len(places) != len(orientations):
        raise RequestError("poses", "expected a position in every pose, or in none")
    return orientations, places


def _check_poses(
    orientations: Sequence[Orientation],
    rates: Sequence[Vector3],
    places: Sequence[Vector3],
) -> None:
    """Check that there is a pose that the daemon does not skip.

    Raises:
        RequestError: there is none.
    """
    for k, q in enumerate(orientations):
        problem = pose_problem(q, rates[k] if rates else None, places[k] if places else None)
        if not problem:
            return
    k = len(orientations) - 1
    text = f"{problem}; none of the {k + 1} is a pose, so there is nothing to play"
    raise RequestError(f"poses[{k}]", text)


def _smoothed(
    stamps: Sequence[int],
    orientations: list[Orientation],
    places: list[Vector3],
    tolerance: float,
    position_tolerance: float,
) -> tuple[list[Orientation], list[Vector3]]:
    """Return a chunk smoothed within the tolerances; what the daemon skips stays as it is."""
    q = np.array(orientations)
    rows = np.array(places) if places else np.zeros((len(q), 3))
    is_pose = np.isfinite(rows).all(axis=1)
    is_pose &= np.abs(np.linalg.norm(q, axis=1) - 1.0) <= NORM_TOLERANCE
    valid = np.flatnonzero(is_pose)
    times, firsts = np.unique(np.array(stamps)[valid], return_index=True)
    seconds, valid = 1e-9 * (times - times[:1]), valid[firsts]
    if tolerance > 0.0:
        q[valid] = smoothed_orientations(seconds, q[valid], tolerance)
    if position_tolerance > 0.0:
        rows[valid] = smoothed_positions(seconds, rows[valid], position_tolerance)
    turned: list[Orientation] = [(w, x, y, z) for w, x, y, z in q.tolist()]
    return turned, [(x, y, z) for x, y, z in rows.tolist()] if places else places


def _components(given: object) -> Quaternion | None:
    """Return a quaternion unchanged, whatever its norm; ``None`` if it is not well formed."""
    mapping = to_plain(given)
    if not isinstance(mapping, Mapping) or set(mapping) != set("wxyz"):
        return None
    if not all(isinstance(number, int | float) for number in mapping.values()):
        return None
    return Quaternion(**mapping)


def _is_no_pose(pose: object) -> bool:
    """Whether a pose has numbers that are not finite or all zero, and is well formed otherwise."""
    numbers: list[float] = []
    left = [to_plain(pose)]
    while left:
        entry = left.pop()
        if isinstance(entry, Mapping):
            left.extend(entry.values())
        elif isinstance(entry, list):
            left.extend(entry)
        elif isinstance(entry, int | float):
            numbers.append(entry)
    return bool(numbers) and (not any(numbers) or not all(map(math.isfinite, numbers)))


def _stamps(
    count: int, rate: float | None, start: float | None, times: ArrayLike | None
) -> list[int]:
    """Return the times of the poses, ns of this machine's monotonic clock.

    Raises:
        RequestError: they are not given, not finite, of another clock, or too far ahead or ago.
    """
    if times is not None:
        if rate is not None or start is not None:
            raise RequestError("times", "expected either times, or rate and start")
        place = "times"
        seconds = [
            _seconds(f"times[{k}]", one) for k, one in enumerate(_one_each("times", times, count))
        ]
    else:
        place = "start"
        if not _is_number(rate) or not 0.0 < rate <= MOST_RATE_HZ:
            problem = f"expected more than 0 and at most {MOST_RATE_HZ:g} poses a second, or times"
            raise RequestError("rate", f"{problem}, got {rate!r}")
        if start is not None and not _is_number(start):
            raise RequestError("start", f"expected seconds of {CLOCK}, got {start!r}")
        first = time.monotonic() + 1.0 / rate if start is None else start
        seconds = [first + k / rate for k in range(count)]
    for k, when in enumerate(seconds):
        if not math.isfinite(when):
            where = f"times[{k}]" if times is not None else place
            problem = f"expected a finite number of seconds, got {when}; give {CLOCK}"
            raise RequestError(where, problem)
    stamps, now_ns = [round(1e9 * when) for when in seconds], time.monotonic_ns()
    check_chunk_times(place, min(stamps), max(stamps), now_ns, is_seconds=True, clock=CLOCK)
    return stamps


def _observed_ns(observed: object) -> int:
    """Return the time of an observation, ns of this machine's monotonic clock.

    Raises:
        RequestError: it is no time, to come, or too long ago.
    """
    if not _is_number(observed) or not math.isfinite(observed):
        raise RequestError("observed", f"expected seconds of {CLOCK}, got {observed!r}")
    observed_ns, now_ns = round(1e9 * float(observed)), time.monotonic_ns()
    problem = stamp_problem(observed_ns, now_ns, ahead=0.0, is_seconds=True, clock=CLOCK)
    if problem:
        raise RequestError("observed", problem)
    return observed_ns


def _seconds(place: str, given: object) -> float:
    """Return a time.

    Raises:
        RequestError: it is not a number.
    """
    try:
        return float(given)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        problem = f"expected seconds of {CLOCK}, got {given!r}; give a number"
        raise RequestError(place, problem) from None


def _is_number(given: object) -> TypeGuard[float]:
    return isinstance(given, SupportsFloat) and not isinstance(given, bool | str)


def _rows(name: str, given: object, count: int) -> list[Vector3]:
    """Return the rows of three numbers of an argument, one for each pose.

    Raises:
        RequestError: there are more or fewer rows, or one is not three numbers.
    """
    rows = _one_each(name, given, count)
    return [vector_of(row, f"{name}[{k}]") for k, row in enumerate(rows)]


def _one_each(name: str, given: object, count: int) -> list[object]:
    """Return the entries of an argument that has one for each pose.

    Raises:
        RequestError: it has more or fewer.
    """
    plain = to_plain(given)
    if isinstance(plain, list) and len(plain) == count:
        return plain
    got = str(len(plain)) if isinstance(plain, list) else repr(plain)
    raise RequestError(name, f"expected {count}, one for each pose, got {got}")
