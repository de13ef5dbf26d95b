"""The log lines of what happens to devices."""

from __future__ import annotations

import logging

from orientd.daemon.device import DeviceEvent, EventKind
from orientd.daemon.observe.log import about
from orientd.protocol import control_pb2 as pb
from orientd.protocol import titled

_log = logging.getLogger(__name__)

_LEVELS = {
    EventKind.FAULT: logging.ERROR,
    EventKind.SERVO_DIED: logging.ERROR,
    EventKind.WARNING: logging.WARNING,
}


class EventLog:
    """Write a line for each event of a device, and one for who commands a motion."""

    def __init__(self) -> None:
        self._died: dict[str, str] = {}

    def hear(self, event: DeviceEvent) -> None:
        """Log an event; called from the device's own thread, or from a command."""
        is_ended = event.outcome is not None
        title = titled(event.motion_number, event.motion_name)
        text = event.reason if is_ended else event.text
        outcome = None
        if event.outcome is not None:
            outcome = pb.Outcome.Name(event.outcome).removeprefix("OUTCOME_").lower()
        _log.log(
            self._level(event),
            "%s: %s%s%s",
            event.device,
            event.kind.value,
            f" {title}" if event.motion_number else "",
            f": {text}" if text else "",
            extra=about(
                device=event.device,
                event=event.kind.value,
                motion=event.motion_number,
                motion_id=event.motion_id,
                motion_name=event.motion_name,
                outcome=outcome,
            ),
        )
        if event.commander:
            duration = event.motion.facts.duration if event.motion is not None else None
            _log.info(
                "%s: motion %s is commanded by %s",
                event.device,
                title,
                event.commander,
                extra=about(
                    device=event.device,
                    motion=event.motion_number,
                    motion_id=event.motion_id,
                    motion_name=event.motion_name,
                    identity=event.identity,
                    planned_duration=duration,
                ),
            )

    def _level(self, event: DeviceEvent) -> int:
        """Return how loudly to log an event: a start that fails again as before is logged once."""
        if event.kind is EventKind.READY:
            self._died.pop(event.device, None)
        elif event.kind is EventKind.SERVO_DIED:
            last, self._died[event.device] = self._died.get(event.device), event.text
            if event.text == last:
                return logging.DEBUG
        return _LEVELS.get(event.kind, logging.INFO)
