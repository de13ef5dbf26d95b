"""Write the events of devices to the log."""

from __future__ import annotations

import logging

from orientd.daemon.device import DeviceEvent, EventKind
from orientd.daemon.log import about
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

    def on_event(self, event: DeviceEvent) -> None:
        """Log an event; called from the device's own thread, or from a command."""
        number, planned = event.motion_number, event.queued and event.queued.planned
        motion_id, name = (planned.id, planned.facts.name) if planned else ("", "")
        title, text, outcome = titled(number, name), event.text, None
        if event.ended is not None:
            ended, text = event.ended
            outcome = pb.Outcome.Name(ended).removeprefix("OUTCOME_").lower()
        _log.log(
            self._level(event),
            "%s: %s%s%s",
            event.device,
            event.kind.value,
            f" {title}" if number else "",
            f": {text}" if text else "",
            extra=about(
                device=event.device,
                event=event.kind.value,
                motion=number,
                motion_id=motion_id,
                motion_name=name,
                outcome=outcome,
            ),
        )
        if event.lease is not None:
            _log.info(
                "%s: motion %s is commanded by %s",
                event.device,
                title,
                event.lease.who,
                extra=about(
                    device=event.device,
                    motion=number,
                    motion_id=motion_id,
                    motion_name=name,
                    identity=event.lease.owner,
                    planned_duration=planned.facts.duration if planned else None,
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
