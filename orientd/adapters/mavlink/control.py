"""The components in control of a MAVLink gimbal."""

from __future__ import annotations

Source = tuple[int, int]
"""System and component of a sender."""

NOBODY: Source = (0, 0)

_KEEP, _TAKE, _RELEASE = -1.0, -2.0, -3.0


def holder(system: float, component: float, present: Source, source: Source) -> Source | None:
    """Return the component in control after a command to configure it.

    Args:
        system: of the new holder; 0 for none, -1 for no change, -2 for the sender, -3 for none if
            the sender is in control.
        component: of the new holder.
        present: the component in control.
        source: the sender.

    Returns:
        System and component; ``None`` if the command is invalid.
    """
    if system == _KEEP:
        return present
    if system == _TAKE:
        return source
    if system == _RELEASE:
        return NOBODY if present == source else present
    if system == 0.0 or component == 0.0:
        return NOBODY
    is_valid = all(0.0 < one < 256.0 and one == int(one) for one in (system, component))
    return (int(system), int(component)) if is_valid else None
