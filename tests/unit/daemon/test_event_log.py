"""Log entries about devices: a start that fails as before is logged once."""

import logging
from types import SimpleNamespace

import pytest

from orientd.daemon.device import DeviceEvent, EventKind, QueuedMotion
from orientd.daemon.observe.journal import EventLog
from orientd.protocol import control_pb2 as pb

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


def test_a_motion_that_starts_is_logged_with_who_commands_it(caplog):
    planned = SimpleNamespace(id="a1", facts=SimpleNamespace(name="fetch", duration=2.0))
    lease = SimpleNamespace(who="ana (user:1)", owner="user:1")
    queued = QueuedMotion(planned, number=3)
    event = DeviceEvent("arm", EventKind.MOTION_STARTED, "2.000 s", 0, queued, lease=lease)
    with caplog.at_level(logging.INFO):
        EventLog().on_event(event)
    assert [record.getMessage() for record in caplog.records] == [
        "arm: motion started 3 'fetch': 2.000 s",
        "arm: motion 3 'fetch' is commanded by ana (user:1)",
    ]


def test_a_motion_that_ends_is_logged_with_the_reason(caplog):
    ended = pb.OUTCOME_STOPPED, "stopped by ben"
    queued, text = QueuedMotion(number=3), "stopped on its path"
    event = DeviceEvent("arm", EventKind.MOTION_STOPPED, text, 0, queued, ended)
    with caplog.at_level(logging.INFO):
        EventLog().on_event(event)
    assert caplog.records[0].getMessage() == "arm: motion stopped 3: stopped by ben"
