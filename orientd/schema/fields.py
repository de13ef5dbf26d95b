"""The fields of a motion request, of which every way to write one consists.

A field is declared once: as an attribute of :class:`~orientd.planner.MotionRequest` or of
:class:`~orientd.planner.Keyframe`, with its type, its default, and a line of the class's
docstring.  From these follow the keys of a motion file and how they are read, its JSON Schema, and
the way to a message and back (:mod:`orientd.rpc.motion`).

>>> [field.name for field in KEYFRAME]
['time', 'q', 'position', 'turns', 'free_roll', 'frame', 'relative', 'name']
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from enum import Enum, auto
from inspect import cleandoc
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from orientd.planner import Frame, Keyframe, Limits, MotionRequest, Quaternion, Vector3


class FieldKind(Enum):
    """What a field holds; each way to write a request knows how to write every kind."""

    TEXT = auto()
    TEXTS = auto()
    FLAG = auto()
    WHOLE = auto()
    NUMBER = auto()
    VECTOR = auto()
    CHOICE = auto()
    CHOICE_OR_NUMBER = auto()
    OPTIONS = auto()
    LIMITS = auto()
    ORIENTATION = auto()
    KEYFRAMES = auto()
    FRAMES = auto()


_KINDS: tuple[tuple[Any, FieldKind], ...] = (
    (str, FieldKind.TEXT),
    (Sequence[str], FieldKind.TEXTS),
    (bool, FieldKind.FLAG),
    (int, FieldKind.WHOLE),
    (float, FieldKind.NUMBER),
    (Vector3, FieldKind.VECTOR),
    (Mapping[str, Any], FieldKind.OPTIONS),
    (Limits, FieldKind.LIMITS),
    (Quaternion, FieldKind.ORIENTATION),
    (Sequence[Keyframe], FieldKind.KEYFRAMES),
    (Mapping[str, Frame], FieldKind.FRAMES),
)


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a request.

    Attributes:
        name: its key.
        kind: what it holds.
        choices: the texts that it may be, of a choice, or of one where a number does, too.
        is_needed: whether it has no default.
        is_nullable: whether nothing may be said in so many words.
        default: what holds where nothing is said.
        says: what it is, in words.
    """

    name: str
    kind: FieldKind
    choices: tuple[str, ...]
    is_needed: bool
    is_nullable: bool
    default: Any
    says: str


def attribute_lines(of: type) -> dict[str, str]:
    """Return what the docstring of a class says of each of its attributes."""
    _, _, listed = cleandoc(of.__doc__ or "").partition("Attributes:\n")
    listed = re.split(r"^\S", listed, maxsplit=1, flags=re.MULTILINE)[0]
    entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", listed, flags=re.MULTILINE)
    return {name: " ".join(said.split()) for name, said in entries}


def _fields(of: type) -> tuple[Field, ...]:
    hints, lines = get_type_hints(of, localns={"Limits": Limits}), attribute_lines(of)
    return tuple(
        _field(entry, hints[entry.name], lines.get(entry.name, ""))
        for entry in fields(of)
        if entry.init
    )


def _field(entry: Any, hint: Any, says: str) -> Field:  # noqa: ANN401 - of a dataclass, and a type
    made = entry.default_factory
    default = entry.default if made is MISSING else made()
    kinds = [part for part in (get_args(hint) or (hint,)) if part is not NoneType]
    is_nullable = NoneType in get_args(hint)
    bare = kinds[0] if is_nullable else hint
    is_choice = get_origin(bare) is Literal
    if is_choice:
        kind = FieldKind.CHOICE_OR_NUMBER if float in kinds else FieldKind.CHOICE
    else:
        kind = next(kind for known, kind in _KINDS if known == bare)
    return Field(
        name=entry.name,
        kind=kind,
        choices=get_args(bare) if is_choice else (),
        is_needed=default is MISSING,
        is_nullable=is_nullable,
        default=None if default is MISSING else default,
        says=says,
    )


MOTION: tuple[Field, ...] = _fields(MotionRequest)
KEYFRAME: tuple[Field, ...] = tuple(
    sorted(_fields(Keyframe), key=lambda field: field.name != "time")
)
"""The time comes first where people write keyframes."""
