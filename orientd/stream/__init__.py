"""What crosses the boundary between the daemon and a servo process, over shared memory."""

from orientd.stream.memory import GIVEN_UP_WORD, SharedMemory
from orientd.stream.records import (
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
from orientd.stream.ring import RecordRing

__all__ = [
    "GIVEN_UP_WORD",
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
