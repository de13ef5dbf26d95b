"""Read a recording's states and settings of daemons, and its clocks."""

import json
from typing import NamedTuple

from mcap.records import Attachment, Channel, Message, Metadata

from orientd.protocol import control_pb2 as pb
from orientd.recorder.mcap_file import Damages, records
from orientd.recorder.writer import CLOCK, CONFIGURATION


class ClockFact(NamedTuple):
    """How far a daemon's clock was ahead, and how far that may be wrong; ns."""

    offset_ns: int
    bound_ns: int


def states(path):
    """Return what daemons have said of themselves and their devices, in order."""
    topics, found = {}, []
    for record in records(path, Damages()):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message) and topics[record.channel_id].endswith("/state"):
            found.append(pb.GetStateResponse.FromString(record.data))
    return found


def configurations(path):
    """Return the settings of each daemon, by name; without one outside of a cell."""
    return {
        record.name.removesuffix(CONFIGURATION).removesuffix("/"): json.loads(record.data)
        for record in records(path, Damages())
        if isinstance(record, Attachment)
    }


def clocks(path):
    """Return where the clock of each daemon of a cell stood, time after time, by name."""
    found = {}
    for record in records(path, Damages()):
        if isinstance(record, Metadata) and record.name == CLOCK:
            told = record.metadata
            fact = ClockFact(int(told["offset_ns"]), int(told["bound_ns"]))
            found.setdefault(told["daemon"], []).append(fact)
    return found
