"""The data that the daemon and a servo process exchange over shared memory."""

from orientd.stream.memory import (
    GIVEN_UP_WORD,
    LONGEST_READ_WORD,
    LONGEST_WRITE_WORD,
    PAGE,
    SharedMemory,
    newest_health,
    publish_health,
    tuning_text,
)
from orientd.stream.records import (
    CHUNK_POSES,
    CHUNK_RECORD,
    CYCLE_RECORD,
    JOINTS,
    KNOT_FLOATS,
    MOVING,
    NO_JOINTS,
    NOT_GIVEN,
    PATH_FLOATS,
    UNKNOWN,
    Answer,
    Command,
    Cycle,
    CycleFlag,
    Note,
    NoteKind,
    Sample,
    ServoLimits,
    ServoState,
    Stop,
    pack_note,
    record_index,
    unpack_cycle,
    unpack_note,
)
from orientd.stream.ring import HEAD, RecordRing
