"""What crosses the boundary between the daemon and a servo process, over shared memory."""

from orientd.stream.memory import (
    GIVEN_UP_WORD,
    HALTS_WORD,
    LONGEST_READ_WORD,
    LONGEST_WRITE_WORD,
    PAGE,
    STOPS_WORD,
    TAKEN_AT_WORD,
    TAKEN_WORD,
    SharedMemory,
    newest_health,
    publish_health,
    taken_at,
    tuning_text,
)
from orientd.stream.records import (
    CYCLE_RECORD,
    JOINTS,
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
    ServoLimits,
    ServoState,
    pack_note,
    record_index,
    unpack_cycle,
    unpack_note,
)
from orientd.stream.ring import HEAD, RecordRing
