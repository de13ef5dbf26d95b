"""Which call needs which role: the one table of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from orientd.config import Role

CONTROL = "orientd.v1.Control"


@dataclass(frozen=True)
class Rule:
    """What a call takes.

    Attributes:
        role: needed for it; a higher one will do too.
        is_command: whether it changes something, and is therefore recorded.
        is_limited: whether it counts against what one connection may ask for.
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
"""By the name of the call; anybody who may come in at all may stop."""

_UNLISTED = Rule(Role.ADMINISTRATOR, is_command=True)


def rule(method: str) -> Rule:
    """Return what the call of the full name *method*, ``/service/Name``, takes.

    Health and reflection are for whoever may look; a call that no table has is for administrators.
    """
    service, _, name = method.removeprefix("/").partition("/")
    if service == CONTROL:
        return RULES.get(name, _UNLISTED)
    return _LOOK
