"""All errors that orientd raises, and the kinds of device faults.

An error means that a call failed.  A fault means that a device stopped and waits for a reset.

.. code-block:: text

    OrientdError
    ├── RequestError            a malformed motion file or request (field, problem)
    │   ├── UnknownNameError    it names a device or a plan that does not exist
    │   └── MessageSizeError    its message is larger than the daemon accepts
    ├── ConfigError             a configuration that is malformed, or not possible on this machine
    ├── PlanError               a well-formed motion that cannot be planned
    │   ├── LimitError          it would break a limit (quantity, value, limit, time)
    │   ├── StartError          it does not begin in the commanded state of the device
    │   └── DeadlineError       planning it took too long
    ├── StateError              not possible in the device's current state
    │   ├── StaleBaseError      the orientation of the moving base is too old (since_ns, age)
    │   └── LateError           the device has passed the intended point
    │       └── NotYetError     the running motion cannot be replaced yet
    ├── LeaseError              the caller does not hold the lease
    ├── AccessError             the caller's role does not allow it
    ├── TooMuchError            the caller has too many requests at a time
    ├── DeviceError             raised by drivers, in the servo process
    │   ├── LinkError           the connection to the device is lost
    │   │   └── SpentLinkError  and only a new servo process can reconnect
    │   ├── FeedbackError       feedback is missing or older than its limit
    │   └── DeviceFaultError    the device reports that it cannot continue
    │       └── AxisFaultError  one axis cannot; the others can still brake on the path
    ├── DaemonError             the daemon is not running, is already running, or did not answer
    └── KernelsError            the compiled kernels are missing, or not for this machine
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum, IntEnum
from typing import Any, ClassVar

from orientd.one_line import one_line


class Fault(IntEnum):
    """Why a device is in the state ``fault``; crosses the process boundary as a number."""

    NONE = 0
    LINK_LOST = 1
    FEEDBACK_STALE = 2
    DEVICE_FAULT = 3
    LIMIT_GUARD = 4
    PATH_STARVED = 5
    HEARTBEAT_LOST = 6
    SERVO_DIED = 7
    INTERNAL = 8
    SERVO_STALLED = 9

    def __str__(self) -> str:
        return self.name


def _as_it_was(kind: type[OrientdError], args: tuple[Any, ...]) -> OrientdError:
    return kind.__new__(kind, *args)


class OrientdError(Exception):
    """Base class of all errors of orientd.

    Attributes:
        planning: s from a motion's arrival at the daemon to its refusal; 0 for other errors.
        waiting: the part of it spent on earlier motions, a stop, or a change of speed.
    """

    planning = waiting = 0.0

    def __reduce__(self) -> tuple[Any, ...]:
        # The constructor's arguments differ from the exception's: send the attributes instead.
        return _as_it_was, (type(self), self.args), self.__dict__


@contextmanager
def naming(what: str) -> Iterator[None]:
    """Put the name of a file, a device or a daemon in front of an error."""
    try:
        yield
    except OrientdError as error:
        error.args = (f"{what}: {error}", *error.args[1:])
        raise


class RequestError(OrientdError, ValueError):
    """A malformed request.

    Attributes:
        field: path of the offending field, for example ``keyframes[2].quaternion``.
        problem: expected and given value, without the field's name.
    """

    def __init__(self, field: str, problem: str) -> None:
        # Keys and values from users may be of any length and any characters.
        field = one_line(field, 200)
        problem = problem if len(problem) <= 700 else f"{problem[:697]}..."
        super().__init__(f"{field}: {problem}" if field else problem)
        self.field = field
        self.problem = problem


class UnknownNameError(RequestError):
    """A request that names a device or a plan that does not exist."""


class MessageSizeError(RequestError):
    """A request whose message is larger than the daemon accepts."""


class ConfigError(OrientdError):
    """A malformed configuration, or one that names something that does not exist."""


class PlanError(OrientdError):
    """A well-formed motion that cannot be planned."""


class LimitKind(Enum):
    """The subject of a limit, which decides whether a slower motion would keep it."""

    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    JERK = "jerk"
    RANGE = "range"
    """Of an axis: its angles end there at any speed."""
    DEVIATION = "deviation"
    TIME = "time"


class LimitError(PlanError):
    """A motion that would break a limit.

    Attributes:
        kind: subject of the limit.
        quantity: the quantity that breaks it, for example ``angular velocity``.
        value: the largest value, in SI units.
        limit: the allowed value, in the same units.
        time: when the largest value occurs in the motion, in seconds.
        unit: of the value.
        is_in_lead_in: whether it occurs in the lead-in, if that is known.
    """

    def __init__(
        self,
        quantity: str,
        value: float,
        limit: float,
        time: float,
        unit: str,
        advice: str = "",
        *,
        kind: LimitKind,
        is_in_lead_in: bool = False,
    ) -> None:
        text = (
            f"{quantity} reaches {value:.6g} {unit} at {time:.4f} s, "
            f"the limit is {limit:.6g} {unit}"
        )
        super().__init__(f"{text}; {advice}" if advice else text)
        self.kind = kind
        self.quantity = quantity
        self.value = value
        self.limit = limit
        self.time = time
        self.unit = unit
        self.is_in_lead_in = is_in_lead_in


class StartError(PlanError):
    """A motion that does not begin in the commanded state of the device."""


class DeadlineError(PlanError):
    """A motion whose planning exceeded its deadline."""


class StateError(OrientdError):
    """A command that the current state of the device does not allow."""


class StaleBaseError(StateError):
    """A target in the earth frame while the orientation of the moving base is stale.

    The device comes to rest, and points again once a newer sample of the base arrives.

    Attributes:
        since_ns: time from which it is stale, monotonic clock.
        age: of the newest sample, s.
    """

    def __init__(self, sample_ns: int, now_ns: int, life_ns: int) -> None:
        self.since_ns = sample_ns + life_ns
        self.age = (now_ns - sample_ns) * 1e-9
        most, late = life_ns * 1e-9, (now_ns - self.since_ns) * 1e-9
        super().__init__(
            f"the base is stale for {late:.3g} s: its newest sample is {self.age:.3g} s old, "
            f"expected at most {most:g} s; the device rests until a newer one arrives"
        )


class LateError(StateError):
    """A motion was to leave the path at a point that the device has passed."""


class NotYetError(LateError):
    """A motion cannot be replaced or followed at this moment; a little later it can."""


class MotionStopped(OrientdError):  # noqa: N818 - as asyncio has CancelledError: this is an end
    """A motion that was stopped before its end.

    Attributes:
        summary: how it went: a ``MoveSummary``.
    """

    summary: Any = None


class MotionFault(OrientdError):  # noqa: N818
    """A motion that a fault of its device ended.

    Attributes:
        summary: how it went: a ``MoveSummary``.
    """

    summary: Any = None


class LeaseError(OrientdError):
    """A command from a client that does not hold the lease."""


class AccessError(OrientdError):
    """A call that its caller's role does not permit, or of an unknown caller."""


class TooMuchError(OrientdError):
    """More requests, or more at the same time, than one caller may make."""


class DeviceError(OrientdError):
    """Raised by a driver; the servo turns it into a fault.

    Attributes:
        fault: the resulting fault.
        brakes: whether the servo keeps writing setpoints, to brake on the path.  Otherwise it cuts
            off: it writes nothing more and disables the driver at once.
    """

    fault: ClassVar[Fault] = Fault.INTERNAL
    brakes: ClassVar[bool] = False


class LinkError(DeviceError):
    """The connection to the device is lost."""

    fault = Fault.LINK_LOST


class SpentLinkError(LinkError):
    """The connection is lost, and only a new servo process can reconnect."""


class FeedbackError(DeviceError):
    """Feedback is missing, or older than its limit."""

    fault = Fault.FEEDBACK_STALE
    brakes = True


class DeviceFaultError(DeviceError):
    """The device reports that it cannot continue."""

    fault = Fault.DEVICE_FAULT


class AxisFaultError(DeviceFaultError):
    """One axis of the device cannot continue; the others can still brake on the path."""

    brakes = True


class DaemonError(OrientdError):
    """The daemon is not running, is already running, or did not answer."""


class KernelsError(OrientdError, ImportError):
    """The compiled kernels are missing, not for this machine, or built from other sources."""


GOING_DOWN = "the daemon is going down"
"""Reason of stops and refusals once the daemon is ending."""
