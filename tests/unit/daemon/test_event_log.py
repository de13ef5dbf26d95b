"""Log entries about devices: a start that fails as before is logged once."""

import logging

import pytest

from orientd.daemon.device import DeviceEvent, EventKind
from orientd.daemon.observe.journal import EventLog

DIED, READY = EventKind.SERVO_DIED, EventKind.READY


@pytest.mark.parametrize(
    ("events", "said"),
    [
        ([(DIED, "no port")] * 3, ["no port"]),
        (
            [(DIED, "no port"), (DIED, "no servo"), (DIED, "no port")],
            ["no port", "no servo", "no port"],
        ),
        ([(DIED, "no port"), (READY, ""), (DIED, "no port")], ["no port", "no port"]),
    ],
)
def test_a_start_that_fails_as_before_is_said_once(caplog, events, said):
    log = EventLog()
    with caplog.at_level(logging.ERROR):
        for kind, text in events:
            log.on_event(DeviceEvent("arm", kind, text, 0))
    told = [record.getMessage() for record in caplog.records]
    assert told == [f"arm: servo died: {text}" for text in said]
