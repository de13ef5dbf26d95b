"""Read what requests ask for: rates, options of a move, start times."""

from __future__ import annotations

import functools
import math
import time

from orientd.daemon.device import ArrivalCondition, Device, MoveOptions
from orientd.errors import RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd.stream.records import UNKNOWN, ServoState

DEFAULT_REPORTS_HZ = 20.0
SLOWEST_REPORTS_HZ = 0.1
FASTEST_REPORTS_HZ = 100.0

SETTLING_TIMEOUT = 5.0
"""Default time that a device may take to be on target after the last setpoint, s."""

LONGEST_WAIT = 3600.0
"""How far ahead a start time may be, s."""

KEPT_INSTANTS = 64
"""Start times that are remembered, for the motions of other devices."""


def interval(field: str, rate_hz: float) -> float:
    """Return the seconds between reports at *rate_hz*; 0 is the default rate.

    Raises:
        RequestError: the rate of *field* is too low or too high.
    """
    if rate_hz == 0.0:
        return 1.0 / DEFAULT_REPORTS_HZ
    if not SLOWEST_REPORTS_HZ <= rate_hz <= FASTEST_REPORTS_HZ:
        raise RequestError(
            field, f"expected {SLOWEST_REPORTS_HZ:g} to {FASTEST_REPORTS_HZ:g}, got {rate_hz:g}"
        )
    return 1.0 / rate_hz


def path_tolerance(metres: float) -> float:
    """Return the path tolerance of a track, m; 0 is without a bound.

    Raises:
        RequestError: it is negative, or not a number.
    """
    if not metres >= 0.0:
        raise RequestError("start.path_tolerance", f"expected 0 or more metres, got {metres:g}")
    return metres or math.inf


def sample_rate(rate_hz: float, device: Device) -> float:
    """Return the rate at which to sample a motion of *device*; 0 for no samples.

    Raises:
        RequestError: the rate is above that of the device.
    """
    if not 0.0 <= rate_hz <= device.rate_hz:
        raise RequestError("sample_rate_hz", f"expected 0 to {device.rate_hz:g}, got {rate_hz:g}")
    return rate_hz


def planning_timeout(wanted: float, longest: float) -> float:
    """Return the time that planning may take, s; *longest* if *wanted* is 0.

    Raises:
        RequestError: the time is negative or no number.
    """
    if not 0.0 <= wanted < math.inf:
        raise RequestError("plan_timeout", f"expected more than 0 s, got {wanted:g}")
    return min(wanted or longest, longest)


def move_options(request: pb.MoveRequest) -> MoveOptions:
    """Return how the motion of *request* is to begin and to end.

    Raises:
        RequestError: the options are not well formed.
    """
    gate = None
    if request.HasField("on_target"):
        asked = request.on_target
        timeout = asked.timeout or SETTLING_TIMEOUT
        gate = ArrivalCondition(asked.tolerance, asked.rate, asked.settle_time, timeout)
    blend = request.blend_tolerance
    if not 0.0 <= blend < math.pi:
        raise RequestError("blend_tolerance", f"expected 0 to pi rad, got {blend!r}")
    if blend and not request.queue:
        raise RequestError("blend_tolerance", "expected with queue only")
    start_ns = _start_ns(request)
    return MoveOptions(is_queued=request.queue, blend=blend, start_ns=start_ns, gate=gate)


def _start_ns(request: pb.MoveRequest) -> int:
    """Return when the motion of *request* is to begin, monotonic clock."""
    field = "start_ns" if request.start_ns else "start_time"
    if not (request.start_ns or request.HasField("start_time")):
        return UNKNOWN
    if request.queue:
        raise RequestError(field, "expected without queue only")
    if request.start_ns:
        if request.HasField("start_time"):
            raise RequestError(field, "expected without start_time only")
        ahead = request.start_ns - time.monotonic_ns()
    else:
        try:
            wanted_ns = request.start_time.ToNanoseconds()
        except ValueError as error:
            raise RequestError(field, f"expected a time: {error}") from error
        ahead = wanted_ns - time.time_ns()
    if not 0 < ahead <= LONGEST_WAIT * 1e9:
        raise RequestError(
            field, f"expected up to {LONGEST_WAIT:g} s ahead of now, got {ahead * 1e-9:.6g} s"
        )
    return request.start_ns or _instant(wanted_ns)


@functools.lru_cache(KEPT_INSTANTS)
def _instant(time_ns: int) -> int:
    """Return when it will be *time_ns* since the epoch, on the monotonic clock.

    All requests for one time get the same instant, even if the wall clock is set meanwhile.
    """
    return time.monotonic_ns() + time_ns - time.time_ns()


def check_moving(device: Device, what: str) -> None:
    """Check that *device* is on a motion to do *what* to.

    Raises:
        StateError: it is on none.
    """
    state = device.snapshot().state
    if state is not ServoState.STREAMING:
        raise StateError(f"device {device.name} is {state.name.lower()}: no motion to {what}")
