"""What a motion request consists of, for every way to write one."""

from __future__ import annotations

from orientd.schema.fields import KEYFRAME, MOTION, Field, FieldKind, attribute_lines
from orientd.schema.frames import read_frames, written_frames
from orientd.schema.json_schema import motion_schema
from orientd.schema.orientations import (
    FORMS,
    Written,
    form_notes,
    implied,
    quaternions,
    the_only,
)
