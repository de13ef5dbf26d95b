"""Every error orientd raises, and the kinds of fault a device can be in.

An error is ours (a call failed); a fault is the device's (it stopped and waits for a reset).

.. code-block:: text

    OrientdError
    ├── RequestError            a motion file or request that is not well formed (field, problem)
    │   ├── UnknownNameError    it names a device or a plan that is not there
    │   └── MessageSizeError    its message is larger than the daemon takes
    ├── ConfigError             a configuration that is not well formed or not possible here
    ├── PlanError               a well-formed motion that cannot be planned
    │   ├── LimitError          it would break a limit (quantity, value, limit, time)
    │   ├── StartError          it does not begin where the device is commanded to be
    │   └── DeadlineError       planning it took too long
    ├── StateError              not possible in the device's present state
    │   └── LateError           the device has gone past the point that it was for
    ├── LeaseError              the caller does not hold the lease
    ├── AccessError             the caller may not do that, whoever holds the lease
    ├── TooMuchError            the caller asks for more at a time than one may
    ├── DeviceError             raised by drivers, in the servo process
    │   ├── LinkError           the connection to the device is gone
    │   │   └── SpentLinkError  and only a new servo process can make another
    │   ├── FeedbackError       feedback is missing or older than its limit
    │   └── DeviceFaultError    the device says that it cannot go on
    │       └── AxisFaultError  one axis cannot; the others can still be braked on the path
    ├── DaemonError             the daemon is not there, is there already, or did not answer
    └── KernelsError            the compiled kernels are not there, or not for this machine
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import Any, ClassVar


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
    """The root of everything orientd raises about the world.

    Attributes:
        planning: s from a motion's arrival at the daemon until it was refused; 0 for what is no
            refusal of a motion.
        waiting: of these spent on motions asked for before, a stop, a change of speed.
    """

    planning = waiting = 0.0

    def __reduce__(self) -> tuple[Any, ...]:
        # A constructor's arguments are not the exception's: what it has become is what crosses.
        return _as_it_was, (type(self), self.args), self.__dict__


class RequestError(OrientdError, ValueError):
    """A request that is not well formed.

    Attributes:
        field: path of the offending field, for example ``keyframes[2].quaternion``.
        problem: what was expected and what came, without the field's name.
    """

    def __init__(self, field: str, problem: str) -> None:
        # Keys and values that somebody else has written may be of any length.
        field = field if len(field) <= 200 else f"{field[:197]}..."
        problem = problem if len(problem) <= 700 else f"{problem[:697]}..."
        super().__init__(f"{field}: {problem}" if field else problem)
        self.field = field
        self.problem = problem


class UnknownNameError(RequestError):
    """A request that names a device or a plan that is not there."""


class MessageSizeError(RequestError):
    """A request whose message is larger than the daemon takes."""


class ConfigError(OrientdError):
    """A configuration that is not well formed, or that names what is not there."""


class PlanError(OrientdError):
    """A well-formed motion that cannot be planned."""


class LimitKind(Enum):
    """What a limit is about, which decides whether a slower motion would keep it."""

    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    JERK = "jerk"
    RANGE = "range"
    """Of an axis: its angles end there, however slow the motion is."""
    DEVIATION = "deviation"
    TIME = "time"


class LimitError(PlanError):
    """A motion that would break a limit.

    Attributes:
        kind: what the limit is about.
        quantity: what breaks it, for example ``angular velocity``.
        value: the largest value reached, in SI units.
        limit: what was allowed, in the same units.
        time: when in the motion the largest value occurs, in seconds.
        unit: of the value.
        is_in_lead_in: whether that is on the way to the first keyframe, where that is known.
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
    """A motion that does not begin in the state the device is commanded to be in."""


class DeadlineError(PlanError):
    """A motion that was not planned within the time for it."""


class StateError(OrientdError):
    """A command that the device's present state does not allow."""


class LateError(StateError):
    """A motion was to leave the path at a point that the device has passed."""


class NotYetError(LateError):
    """A motion cannot be replaced or followed at this moment; a little later it can."""


class LeaseError(OrientdError):
    """A command from somebody who does not hold the lease."""


class AccessError(OrientdError):
    """A call that its caller's role does not permit, or of somebody unknown."""


class TooMuchError(OrientdError):
    """More requests, or more at the same time, than one caller may make."""


class DeviceError(OrientdError):
    """What a driver raises; the servo turns it into a fault.

    Attributes:
        fault: the fault that it becomes.
        brakes: whether the servo goes on writing setpoints, to brake on the path; else it cuts off:
            it writes nothing more and disables the driver at once.
    """

    fault: ClassVar[Fault] = Fault.INTERNAL
    brakes: ClassVar[bool] = False


class LinkError(DeviceError):
    """The connection to the device is gone."""

    fault = Fault.LINK_LOST


class SpentLinkError(LinkError):
    """The connection is gone, and only a new servo process can make another."""


class FeedbackError(DeviceError):
    """Feedback is missing, or older than its limit."""

    fault = Fault.FEEDBACK_STALE
    brakes = True


class DeviceFaultError(DeviceError):
    """The device says that it cannot go on."""

    fault = Fault.DEVICE_FAULT


class AxisFaultError(DeviceFaultError):
    """One axis of the device cannot go on; the others can still be braked on the path."""

    brakes = True


class DaemonError(OrientdError):
    """The daemon is not there, is there already, or did not answer."""


class KernelsError(OrientdError, ImportError):
    """The compiled kernels are not there, or not for this machine, or of other sources."""


GOING_DOWN = "the daemon is going down"
"""Why motions stop and calls are refused once the daemon was told to end."""
