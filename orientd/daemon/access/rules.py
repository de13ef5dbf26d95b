"""Which call needs which role: the one table of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from orientd.config import Role

CONTROL = "orientd.v1.Control"


@dataclass(frozen=True)
class Rule:
    """Describe the requirements of a call.

    Attributes:
        role: lowest role that may make it.
        is_command: whether it changes something, and is therefore recorded.
        is_limited: whether it counts against the limit of calls at once of one identity.
    """

    role: Role
    is_command: bool = False
    is_limited: bool = True


_LOOK = Rule(Role.OBSERVER)
_PLAN = Rule(Role.OPERATOR)
_STOP = Rule(Role.OBSERVER, is_command=True, is_limited=False)
_COMMAND = Rule(Role.OPERATOR, is_command=True)

RULES: Mapping[str, Rule] = {
    "GetState": _LOOK,
    "WatchState": _LOOK,
    "WatchEvents": _LOOK,
    "GetConfiguration": _LOOK,
    "GetPlan": _LOOK,
    "ListMethods": _LOOK,
    "ListDevices": _LOOK,
    "Plan": _PLAN,
    "Stop": _STOP,
    "Halt": _STOP,
    "Move": _COMMAND,
    "Track": _COMMAND,
    "Pause": _COMMAND,
    "Resume": _COMMAND,
    "SetSpeed": _COMMAND,
    "Enable": _COMMAND,
    "Disable": _COMMAND,
    "Reset": _COMMAND,
    "AcquireLease": _COMMAND,
    # Several times a lease; a renewal that is refused is recorded like every refusal.
    "RenewLease": Rule(Role.OPERATOR, is_limited=False),
    "ReleaseLease": _COMMAND,
    "SeizeLease": Rule(Role.ADMINISTRATOR, is_command=True),
}
"""By the name of the call; every client that may connect may stop."""

_UNLISTED = Rule(Role.ADMINISTRATOR, is_command=True)


def rule(method: str) -> Rule:
    """Return the requirements of a call by its full name *method*, ``/service/Name``.

    Health and reflection need the lowest role.  A call that no table lists needs an administrator.
    """
    service, _, name = method.removeprefix("/").partition("/")
    if service == CONTROL:
        return RULES.get(name, _UNLISTED)
    return _LOOK
