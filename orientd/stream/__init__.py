"""What crosses the boundary between the daemon and a servo process, over shared memory."""

from orientd.stream.memory import GIVEN_UP_WORD, SharedMemory
from orientd.stream.records import (
    CYCLE_RECORD,
    JOINTS,
    NO_JOINTS,
    UNKNOWN,
    Answer,
    Command,
    Cycle,
    CycleFlag,
    Note,
    NoteKind,
    PathFlag,
    State,
    Terms,
    pack_note,
    unpack_cycle,
    unpack_note,
)
from orientd.stream.ring import HEAD, RecordRing

__all__ = [
    "CYCLE_RECORD",
    "GIVEN_UP_WORD",
    "HEAD",
    "JOINTS",
    "NO_JOINTS",
    "UNKNOWN",
    "Answer",
    "Command",
    "Cycle",
    "CycleFlag",
    "Note",
    "NoteKind",
    "PathFlag",
    "RecordRing",
    "SharedMemory",
    "State",
    "Terms",
    "pack_note",
    "unpack_cycle",
    "unpack_note",
]
