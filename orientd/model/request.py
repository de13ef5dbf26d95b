"""The request of a motion: keyframes, end velocities, limits and start.

A request is one model for every way to make it.  The keys of a motion file, the arguments in
Python and the fields of the message are its attributes.  A request that exists is well formed:
:class:`~orientd.errors.RequestError` names the field that is not.

Quaternions are ``(w, x, y, z)`` here; a mapping names their components.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import field, fields
from functools import cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from orientd.errors import RequestError
from orientd.model.cones import Cones
from orientd.model.fields import (
    CONFIG,
    AskedLimits,
    AzimuthElevation,
    EulerAngles,
    Flag,
    LookAt,
    Name,
    Number,
    Options,
    Quaternion,
    Rows,
    Text,
    Vector3,
    Whole,
    word_or_number,
)
from orientd.model.orientation import DIRECTIONS, FORMS, read
from orientd.model.refusal import refusing
from orientd.tolerances import NORM_TOLERANCE, TYPED_NORM_TOLERANCE

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

    from orientd.rotation import Floats

    Turns = np.ndarray[Any, np.dtype[np.int64]]

DEFAULT_METHOD = "c2_cumulative"
"""The interpolation method of a request that names none."""

IDENTITY = (1.0, 0.0, 0.0, 0.0)
LONGEST_NOTE = 300
"""Characters."""
MOST_NOTES, MOST_TURNS = 20, 1000
FARTHEST = 1e12
"""Largest coordinate of a position, m; squares of larger ones overflow."""
MOST_FRAMES = 100
"""Most frames of one request."""
FARTHEST_FRAME = 1e6
"""Largest distance between two frames along each axis, m."""

_NONE: Any = None  # replaced by `q` once the orientation has been read
_FEW = 3  # keyframes that repr() shows in full
_FRAME_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,31}")

Pace = Literal["even"]


def _read_orientation(of: Any, forms: Sequence[str], tolerance: float) -> None:  # noqa: ANN401
    """Set the quaternion of a pose or keyframe from the one form that gives its orientation."""
    given = {form: value for form in forms[1:] if (value := getattr(of, form)) is not None}
    if of.q is not None:
        given["quaternion"] = of.q
    if len(given) != 1:
        both = " and ".join(form for form in forms if form in given)
        came = f"{both}; keep one" if both else "none of them; add one"
        raise RequestError("", f"expected one of {', '.join(forms)}; got {came}")
    ((form, value),) = given.items()
    q, note = read(form, value, tolerance)
    if q is not of.q:
        _change(of, q=q)
    if form != "quaternion":
        _change(of, **{form: None})
    if form in DIRECTIONS:
        _change(of, free_roll=True)
    if note:
        _change(of, note=f"{form} {note}")


def _change(of: object, **changes: object) -> None:
    """Set attributes of a frozen object in its own constructor."""
    for name, value in changes.items():
        object.__setattr__(of, name, value)


@refusing
@dataclass(frozen=True, config=CONFIG)
class Pose:
    """The pose of one coordinate system in another.

    Attributes:
        q: orientation ``(w, x, y, z)``, of unit norm within 1e-6.
        position: of the origin, m.
        rotation_vector: the orientation as axis times angle, rad.
        euler: the orientation as successive turns about coordinate axes.
        matrix: the orientation as rotation matrix for column vectors, row by row.
    """

    q: Quaternion = Field(default=_NONE, validation_alias="quaternion")
    position: Vector3 = (0.0, 0.0, 0.0)
    rotation_vector: Vector3 | None = Field(default=None, kw_only=True, repr=False)
    euler: EulerAngles | None = Field(default=None, kw_only=True, repr=False)
    matrix: Rows | None = Field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if all(one is None for one in (self.q, self.rotation_vector, self.euler, self.matrix)):
            _change(self, q=IDENTITY)
        _read_orientation(self, FORMS[:4], NORM_TOLERANCE)
        if max(map(abs, self.position)) > FARTHEST_FRAME:
            expected = f"three numbers of at most {FARTHEST_FRAME:g} m"
            step = "give metres"
            raise RequestError("position", f"expected {expected}, got {self.position!r}; {step}")


@refusing
@dataclass(frozen=True, config=CONFIG)
class Frame:
    """The tool that keyframes describe, and the workpiece that they are relative to.

    Attributes:
        base: pose of the workpiece in the device's base frame: ``q_world_base`` and its origin.
        tool: pose of the tool on the flange: ``q_flange_tool`` and its origin.
    """

    base: Pose = field(default_factory=Pose)
    tool: Pose = field(default_factory=Pose)

    def pose(self, q: ArrayLike, position: ArrayLike) -> tuple[Floats, Floats]:
        """Return orientation and position of the tool, relative to the base.

        Args:
            q: orientations of the flange in the world, shape ``(..., 4)``.
            position: of the flange in the world, m, shape ``(..., 3)``.
        """
        import numpy as np

        from orientd.rotation import conjugate, multiply, rotate

        to_base = conjugate(self.base.q)
        from_base = np.asarray(position) + rotate(q, self.tool.position) - self.base.position
        return multiply(to_base, multiply(q, self.tool.q)), rotate(to_base, from_base)

    def vector(self, body: ArrayLike) -> Floats:
        """Return vectors, shape ``(..., 3)``, converted from flange to tool coordinates."""
        from orientd.rotation import conjugate, rotate

        return rotate(conjugate(self.tool.q), body)


@refusing
@dataclass(frozen=True, config=CONFIG)
class Keyframe:
    """An orientation to pass through, with its time and position.

    Give the orientation in one form.  Whichever form that is, *q* has it.

    Attributes:
        q: a unit quaternion ``(w, x, y, z)``, Hamilton's product, tool to world.  If its norm is
            off by 1e-6 to 1e-3, it is scaled to 1, with a note in the certificate.
        rotation_vector: axis times angle, rad.
        euler: successive turns about coordinate axes.
        matrix: rotation matrix for column vectors, row by row.
        direction: pointing direction, of any length; the roll is free.
        azimuth_elevation: pointing direction as angles; the roll is free.
        look_at: a point to look at, m, alone (from the origin) or with the position to look from;
            the roll is free.
        time: time of the keyframe, s; without times the planner chooses them.
        position: of the tool in the base frame, m; without it the motion commands no position.
        turns: whole turns to add between the previous keyframe (or the current orientation) and
            this one.  An exact half turn is in the positive direction about z of the tool (about y
            or x if its axis has no z); ``turns: -1`` makes it negative.
        free_roll: whether only the direction of the tool's x axis matters.
        frame: name of the frame of this keyframe; empty for that of the motion.
        relative: whether the pose is relative to the tool's pose at the start of the motion.
        name: label for users; at most 80 printable characters.
    """

    note: ClassVar[str] = ""
    """The certificate's note on how the orientation was read, without the keyframe."""
    is_added: ClassVar[bool] = False
    """Whether the planner has added it to the user's keyframes."""

    q: Quaternion = Field(default=_NONE, validation_alias="quaternion")
    rotation_vector: Vector3 | None = Field(default=None, kw_only=True, repr=False)
    euler: EulerAngles | None = Field(default=None, kw_only=True, repr=False)
    matrix: Rows | None = Field(default=None, kw_only=True, repr=False)
    direction: Vector3 | None = Field(default=None, kw_only=True, repr=False)
    azimuth_elevation: AzimuthElevation | None = Field(default=None, kw_only=True, repr=False)
    look_at: LookAt | None = Field(default=None, kw_only=True, repr=False)
    time: Number | None = None
    position: Vector3 | None = None
    turns: Whole = 0
    free_roll: Flag = False
    frame: Text = ""
    relative: Flag = False
    name: Name = ""

    def __post_init__(self) -> None:
        _read_orientation(self, FORMS, TYPED_NORM_TOLERANCE)
        if abs(self.turns) > MOST_TURNS:
            problem = f"expected at most {MOST_TURNS} turns, got {self.turns}; give fewer"
            raise RequestError("turns", problem)
        if self.position is not None and (far := max(map(abs, self.position))) > FARTHEST:
            problem = f"expected at most {FARTHEST:g} m, got {far:g} m; give metres"
            raise RequestError("position", problem)


def named_frames(given: Mapping[str, Frame]) -> Mapping[str, Frame]:
    """Return *given* as an immutable mapping.

    Raises:
        RequestError: there are too many frames, or a name is not valid.
    """
    if len(given) > MOST_FRAMES:
        raise RequestError("", f"expected at most {MOST_FRAMES}, got {len(given)}")
    for name in given:
        if not _FRAME_NAME.fullmatch(name):
            expected = "expected a letter, then at most 31 letters, digits, '-' or '_'"
            raise RequestError("", f"{expected}, got {name!r}; choose another name")
    return MappingProxyType(dict(given))


if TYPE_CHECKING:
    Keyframes = Sequence[Keyframe]
    Frames = Mapping[str, Frame]
    Notes = Sequence[str]
    Duration = Literal["minimum"] | float
    Paced = Pace | float
else:
    Keyframes = Annotated[tuple[Keyframe, ...], Field(fail_fast=True)]
    Frames = Annotated[dict[Text, Frame], AfterValidator(named_frames)]
    Notes = tuple[Text, ...]
    Duration = Annotated[
        Literal["minimum"] | Number, word_or_number("minimum", math.inf, "seconds")
    ]
    Paced = Annotated[Literal["even"] | Number, word_or_number("even", 1.0, "a share up to 1")]


@refusing
@dataclass(frozen=True, repr=False, config=CONFIG)
class MotionRequest:
    """A requested motion.

    Attributes:
        keyframes: at least one, or none with a *rate*. A single one is the goal of a motion from
            the current orientation.
        method: a name in :data:`orientd.curves.METHODS`.
        start_velocity: angular velocity at the first keyframe, rad/s; by default at rest, if the
            method can.
        end_velocity: angular velocity at the last keyframe, rad/s; by default at rest, if the
            method can.
        velocity_frame: frame of these velocities: ``body`` is the tool, ``world`` the base.
        approach: whether to plan a lead-in from the current state of the device; always with a
            single keyframe.
        limits: limits that are narrower than the device's own; infinite ones change nothing.
        options: options of the method.
        device_options: options of the device's driver, for this motion only.  The planner checks
            them when it plans for a device.
        duration: time from the first to the last keyframe, s, for keyframes without times; by
            default ``"minimum"``. With a *rate*, the duration of the turn.
        pace: for keyframes without times: a share of the full speed, or ``"even"`` for the method's
            own timing, slowed down by one factor.
        name: label of the motion in reports and logs; at most 80 printable characters.
        pointing_axis: tool axis that points, for keyframes that only give a direction.
        frame: name of the frame of keyframes, end velocities and reports; empty for the flange in
            the base frame.
        frames: frames by name, in addition to those of the device's configuration.  They override
            frames of the same name.
        rate: angular velocity of a turn from the current orientation, rad/s, in *velocity_frame*.
            The turn lasts *duration* and is at rest at both ends.
        keep_out: up to 8 cones that an axis of the tool stays outside of during this motion, in
            addition to those of the device.
        notes: notes for the certificate, for example that a quaternion was scaled; at most 20 lines
            of 300 printable characters.

    Raises:
        RequestError: a field is malformed.
    """

    keyframes: Keyframes = ()
    method: Text = DEFAULT_METHOD
    start_velocity: Vector3 | None = None
    end_velocity: Vector3 | None = None
    velocity_frame: Literal["body", "world"] = "body"
    approach: Flag = False
    limits: AskedLimits | None = None
    options: Options = field(default_factory=dict)
    device_options: Options = field(default_factory=dict)
    duration: Duration | None = None
    pace: Paced | None = None
    name: Name = ""
    pointing_axis: Literal["x", "y", "z"] = "x"
    frame: Text = ""
    frames: Frames = field(default_factory=dict)
    rate: Vector3 | None = None
    keep_out: Cones = ()
    notes: Notes = ()

    def __post_init__(self) -> None:
        keyframes = self.keyframes
        if not keyframes and self.rate is not None:
            keyframes = (Keyframe(IDENTITY, relative=True),)
        if not keyframes:
            raise RequestError("keyframes", "expected at least 1, got 0; add one")
        notes = (*self.notes, *_reading_notes(keyframes, self.notes))
        _check_notes(notes)
        _check_times([one.time for one in keyframes])
        if len(keyframes) > 1 and keyframes[0].turns:
            problem = f"there is no keyframe before the first, got {keyframes[0].turns} turns"
            raise RequestError("keyframes[0].turns", problem)
        is_single = len(keyframes) == 1
        _change(self, keyframes=keyframes, notes=notes, approach=self.approach or is_single)
        if is_single:
            self._check_single()
        self._check_pace()

    def __hash__(self) -> int:
        return hash((self.keyframes, self.method, self.start_velocity, self.end_velocity))

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(MotionRequest, **self.given()), ()

    def __repr__(self) -> str:
        given = self.given()
        keyframes = given.pop("keyframes")
        is_short = len(keyframes) <= _FEW
        said = repr(list(keyframes)) if is_short else f"{len(keyframes)} keyframes"
        if self.has_times and not is_short:
            said += f" from {keyframes[0].time:g} s to {keyframes[-1].time:g} s"
        # Arguments that differ from their defaults, and always the method.
        usual: tuple[object, ...] = (None, False, {}, "body", "", "x", ())
        others = [f"{k}={v!r}" for k, v in given.items() if k == "method" or v not in usual]
        return f"MotionRequest({', '.join([said, *others])})"

    def given(self) -> dict[str, Any]:
        """Return the arguments that make this request, by name."""
        made = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in made.items()
        }

    @cached_property
    def keys(self) -> Floats:
        """The orientations, unit to rounding, shape ``(n, 4)``."""
        import numpy as np

        return np.array([one.q for one in self.keyframes])

    @cached_property
    def times(self) -> Floats | None:
        """The keyframes' times in seconds, shape ``(n,)``, or ``None``."""
        import numpy as np

        return np.array([one.time for one in self.keyframes]) if self.has_times else None

    @cached_property
    def positions(self) -> Floats | None:
        """Positions, shape ``(n, 3)``, NaN where a keyframe has none; ``None`` if all lack one."""
        import numpy as np

        places = [one.position for one in self.keyframes]
        if all(place is None for place in places):
            return None
        return np.array([(math.nan,) * 3 if place is None else place for place in places])

    @cached_property
    def turns(self) -> Turns:
        """Whole turns beyond the short way, shape ``(n,)``."""
        import numpy as np

        return np.array([one.turns for one in self.keyframes], dtype=np.int64)

    @cached_property
    def omega_start(self) -> Floats | None:
        """The start velocity in the body frame of the first keyframe, rad/s."""
        return self._to_body(self.start_velocity, 0)

    @cached_property
    def omega_end(self) -> Floats | None:
        """The end velocity in the body frame of the last keyframe, rad/s."""
        return self._to_body(self.end_velocity, -1)

    @property
    def has_times(self) -> bool:
        """Whether the keyframes have times."""
        return self.keyframes[0].time is not None

    @property
    def driver_options(self) -> dict[str, Any]:
        """The device options without ``home``, which the planner handles for any gimbal."""
        return {name: given for name, given in self.device_options.items() if name != "home"}

    @property
    def is_single(self) -> bool:
        """Whether there is one keyframe only, and so no curve beyond the lead-in."""
        return len(self.keyframes) == 1

    @property
    def is_quickest(self) -> bool:
        """Whether the timing is the fastest one, or that slowed down."""
        return not self.has_times and self.pace != "even"

    @property
    def total(self) -> float | None:
        """The requested duration in seconds, or ``None``."""
        return None if isinstance(self.duration, str) else self.duration

    def named(self, index: int) -> str:
        """Return what the user calls a keyframe: by its index among those of the user."""
        if self.keyframes[index].is_added:
            return "a keyframe added around a cone"
        return f"keyframes[{sum(not one.is_added for one in self.keyframes[:index])}]"

    def _check_pace(self) -> None:
        for name in ("duration", "pace"):
            if getattr(self, name) is not None and self.has_times:
                raise RequestError(
                    name, "the planner then chooses the times; leave out those of the keyframes"
                )
        if None not in (self.duration, self.pace) and (self.total is None or self.pace != "even"):
            raise RequestError("pace", "a share of the full speed has its own duration; give one")

    def _check_single(self) -> None:
        if self.has_times:
            problem = "is reached as quickly as the limits permit; times need a second one"
            raise RequestError("keyframes[0].time", f"a single keyframe {problem}")
        if self.start_velocity is not None:
            problem = "a single keyframe is the end of a motion: give end_velocity"
            raise RequestError("start_velocity", problem)

    def _to_body(self, velocity: Vector3 | None, index: int) -> Floats | None:
        if velocity is None:
            return None
        import numpy as np

        from orientd.rotation import conjugate, rotate

        if self.velocity_frame == "body":
            return np.array(velocity)
        return rotate(conjugate(self.keys[index]), np.array(velocity))


def _reading_notes(keyframes: Sequence[Keyframe], known: Sequence[str]) -> list[str]:
    """Return the certificate's notes on how the keyframes were read, one line for each form."""
    counts = Counter(one.note.partition(" ")[0] for one in keyframes if one.note)
    lines = []
    for form, count in counts.items():
        index = next(k for k, one in enumerate(keyframes) if one.note.startswith(f"{form} "))
        line = f"keyframes[{index}].{keyframes[index].note}"
        if count > 1:
            more = ", as {} more were" if form == "quaternion" else "; so are {} more"
            line += more.format(count - 1)
        lines.append(line)
    return [line for line in lines if line not in known]


def _check_notes(notes: Sequence[str]) -> None:
    if len(notes) > MOST_NOTES:
        raise RequestError("notes", f"expected at most {MOST_NOTES} lines")
    for index, line in enumerate(notes):
        if len(line) > LONGEST_NOTE or not line.isprintable():
            expected = f"expected at most {LONGEST_NOTE} printable characters"
            raise RequestError(f"notes[{index}]", f"{expected}, got {line[:20]!r}")


def _check_times(times: Sequence[float | None]) -> None:
    """Refuse times that do not increase, or that only some keyframes have."""
    if times.count(None) == len(times):
        return
    before = -math.inf
    for index, time in enumerate(times):
        if time is None or times[0] is None:
            other = next(k for k, one in enumerate(times) if one is not None)
            raise RequestError(
                f"keyframes[{index}].time",
                f"missing: keyframes[{other}] has one, so every keyframe needs one (or none)",
            )
        if time <= before:
            raise RequestError(
                f"keyframes[{index}].time",
                f"{time:.9g} s is the time of keyframes[{index - 1}] too: an interval of length "
                "zero; give it a later time"
                if time == before
                else f"must be later than keyframes[{index - 1}] at {before:.9g} s, got {time:.9g} "
                "s; give times that ascend",
            )
        before = time
