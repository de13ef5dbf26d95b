"""What a planner is asked for: keyframes, velocities at the ends, limits, and where to start.

Every value is checked when it is made, so that a request that exists is well formed whether it
came from a file, from a socket or from Python; :class:`~orientd.errors.RequestError` names the
field.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves import is_same
from orientd.driver import Quaternion, Vector3
from orientd.errors import RequestError
from orientd.rotation import ROUNDING, Floats, check_unit, conjugate, multiply, rotate
from orientd.tolerances import NORM_TOLERANCE, TYPED_NORM_TOLERANCE

if TYPE_CHECKING:
    from orientd.planner.limits import Limits

_FEW = 3
"""Keyframes that a request may have to be shown in full."""

DEFAULT_METHOD = "c2_cumulative"
"""The family of curves of a request that names none."""

LONGEST_NAME, LONGEST_NOTE = 80, 300
"""Characters."""
MOST_NOTES, MOST_TURNS = 20, 1000
FARTHEST = 1e12
"""m from the origin, in every direction; squares of what is further away end in overflow."""

MOST_FRAMES = 100
"""In one request."""
FARTHEST_FRAME = 1e6
"""m from one frame to another, in every direction."""

_FRAME_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,31}")

Turns = np.ndarray[Any, np.dtype[np.int64]]
VelocityFrame = Literal["body", "world"]
Duration = Literal["minimum"]
Pace = Literal["even"]
PointingAxis = Literal["x", "y", "z"]
_CHOICES = {"velocity_frame": ("body", "world"), "pointing_axis": ("x", "y", "z")}
_PACES = ("duration", "minimum", math.inf, "seconds"), ("pace", "even", 1.0, "a share up to 1")


@dataclass(frozen=True, slots=True)
class Pose:
    """Where one coordinate system is, seen from another.

    Attributes:
        q: orientation ``(w, x, y, z)``, of unit norm within 1e-6.
        position: of the origin, m.

    Raises:
        RequestError: one of them is not well formed.
    """

    q: Quaternion = (1.0, 0.0, 0.0, 0.0)
    position: Vector3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        try:
            w, x, y, z = check_unit(self.q).tolist()
        except (TypeError, ValueError) as error:
            raise RequestError("quaternion", str(error)) from error
        expected = f"three numbers of at most {FARTHEST_FRAME:g} m"
        position = _numbers(self.position, 3, "position", expected)
        if max(map(abs, position)) > FARTHEST_FRAME:
            raise RequestError("position", f"expected {expected}, got {self.position!r}")
        # The class is frozen for everybody but its own constructor.
        object.__setattr__(self, "q", (w, x, y, z))
        object.__setattr__(self, "position", tuple(position))


@dataclass(frozen=True, slots=True)
class Frame:
    """What the pose of a keyframe is that of, and what it is seen from.

    Attributes:
        base: from where poses are seen, in the world: ``q_world_base`` and its origin.
        tool: what they are poses of, on the flange: ``q_flange_tool`` and its origin.
    """

    base: Pose = field(default_factory=Pose)
    tool: Pose = field(default_factory=Pose)

    def pose(self, q: ArrayLike, position: ArrayLike) -> tuple[Floats, Floats]:
        """Return orientation and position of the tool, seen from the base.

        Args:
            q: orientations of the flange in the world, shape ``(..., 4)``.
            position: of the flange in the world, m, shape ``(..., 3)``.
        """
        to_base = conjugate(self.base.q)
        from_base = np.asarray(position) + rotate(q, self.tool.position) - self.base.position
        return multiply(to_base, multiply(q, self.tool.q)), rotate(to_base, from_base)

    def vector(self, body: ArrayLike) -> Floats:
        """Return vectors in coordinates of the flange in those of the tool, shape ``(..., 3)``."""
        return rotate(conjugate(self.tool.q), body)


@dataclass(frozen=True, slots=True)
class Keyframe:
    """An orientation to pass, with what goes along with it.

    Attributes:
        q: orientation ``(w, x, y, z)``, tool to world, of unit norm within 1e-3.  One that is off
            by more than 1e-6 is scaled to norm one, with a note in the certificate.
        time: when, in seconds on the request's own axis; ``None`` leaves it to the planner.
        position: of the tool in the world, m; ``None`` where the position is left alone.
        turns: whole turns to make on the way from the previous keyframe to this one, or from where
            the device is to the only one.  Without them a half turn goes the positive way about z
            of the body frame (about y or x where its axis has no z); -1 goes the other way.
        free_roll: whether it only says where to point: to where the first axis of *q* does.
        frame: name of the frame that it is given in; empty for the one of the request.
        relative: whether it is seen from where the tool is when the motion begins.
        name: what people call it; at most 80 printable characters.
    """

    q: Quaternion
    time: float | None = None
    position: Vector3 | None = None
    turns: int = 0
    free_roll: bool = False
    frame: str = ""
    relative: bool = False
    name: str = ""


_ZERO: list[float] = [0.0, 0.0, 0.0]


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Where a device is commanded to be, and how it is moving there.

    Attributes:
        q: orientation ``(w, x, y, z)``, tool to world.
        omega_body: angular velocity, body frame, rad/s.
        alpha_body: its derivative in body components, rad/s^2.
        position: of the tool in the world, m.
        velocity: of the position, m/s.
        acceleration: of the position, m/s^2.
        before: orientations ``(3, 4)`` and positions ``(3, 3)`` of the three setpoints before this
            one, the oldest first; ``None`` where they are not known.
    """

    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats = field(default_factory=lambda: np.zeros(3))
    acceleration: Floats = field(default_factory=lambda: np.zeros(3))
    before: tuple[Floats, Floats] | None = None

    @classmethod
    def at_rest(cls, q: ArrayLike, position: ArrayLike = (0.0, 0.0, 0.0)) -> State:
        """Return the state of holding at *q* and *position*."""
        zero = np.zeros(3)
        return cls(check_unit(q), zero, zero, np.asarray(position, dtype=np.float64))

    @property
    def is_at_rest(self) -> bool:
        """Whether neither velocity nor acceleration is there."""
        is_turning = self.omega_body.tolist() != _ZERO or self.alpha_body.tolist() != _ZERO
        return not (is_turning or self.is_position_moving)

    @property
    def is_known(self) -> bool:
        """Whether the setpoints before it are known: they are where it is at rest."""
        return self.before is not None or self.is_at_rest

    @property
    def is_position_moving(self) -> bool:
        """Whether the position has a velocity or an acceleration."""
        return [*self.velocity.tolist(), *self.acceleration.tolist()] != 2 * _ZERO


@dataclass(frozen=True, eq=False)
class MotionRequest:
    """A motion that somebody asks for.

    Attributes:
        keyframes: at least one; a single one is where to go from wherever the device is.  None with
            a rate.
        method: a name in :data:`orientd.curves.METHODS`.
        start_velocity: angular velocity at the first keyframe, rad/s; ``None`` leaves it to the
            method, which is rest where the method can choose.
        end_velocity: the same at the last keyframe.
        velocity_frame: in which frame these two are given.
        approach: whether to lead in from wherever the device is; always with a single keyframe.
        limits: narrower than the device's own, or ``None``; infinite ones are left to the device.
        options: of the method.
        device_options: of the device's driver, for this motion; checked where it is planned for a
            device.
        duration: without times, from first to last keyframe, s; by default ``"minimum"``.  Of a
            rate, for how long to turn at it.
        pace: without times, a share of the quickest, or ``"even"``, the method's own timing slowed.
        name: what people call the motion, in reports and logs; at most 80 printable characters.
        pointing_axis: axis of the tool that points where keyframes with a free roll say.
        frame: name of the frame of keyframes that name none, of the velocities at these, and of
            reports; empty for the device's own coordinates.
        frames: by name, besides those of the device's configuration, which give way to these.
        rate: angular velocity to turn at from wherever the device is, for the duration, rad/s, in
            the frame of the velocities; it is taken up from rest and left to rest.
        notes: what the certificate repeats of how the request was read, for example that a
            quaternion was scaled to norm one; at most 20 lines of 300 printable characters.
        keys: the orientations, unit to rounding, shape ``(n, 4)``.
        times: the keyframes' times in seconds, shape ``(n,)``, or ``None``.
        positions: shape ``(n, 3)``, not a number where a keyframe has none; or ``None``.
        turns: shape ``(n,)``.

    Raises:
        RequestError: something is not well formed.
    """

    keyframes: Sequence[Keyframe]
    method: str = DEFAULT_METHOD
    start_velocity: Vector3 | None = None
    end_velocity: Vector3 | None = None
    velocity_frame: VelocityFrame = "body"
    approach: bool = False
    limits: Limits | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    device_options: Mapping[str, Any] = field(default_factory=dict)
    duration: Duration | float | None = None
    pace: Pace | float | None = None
    name: str = ""
    pointing_axis: PointingAxis = "x"
    frame: str = ""
    frames: Mapping[str, Frame] = field(default_factory=dict)
    rate: Vector3 | None = None
    notes: Sequence[str] = ()

    keys: Floats = field(init=False, repr=False)
    times: Floats | None = field(init=False, repr=False)
    positions: Floats | None = field(init=False, repr=False)
    turns: Turns = field(init=False, repr=False)

    def __post_init__(self) -> None:
        keyframes = tuple(self.keyframes)
        if not keyframes and self.rate is not None:
            keyframes = (Keyframe((1.0, 0.0, 0.0, 0.0), relative=True),)
        if not keyframes:
            raise RequestError("keyframes", "expected at least 1, got 0")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                *most, last = map(repr, choices)
                expected = f"expected {', '.join(most)} or {last}"
                raise RequestError(name, f"{expected}, got {getattr(self, name)!r}")
        named = {f"keyframes[{k}].name": one.name for k, one in enumerate(keyframes) if one.name}
        for name, text in {"name": self.name, **named}.items():
            if len(text) > LONGEST_NAME or not text.isprintable():
                expected = f"expected at most {LONGEST_NAME} printable characters"
                raise RequestError(name, f"{expected}, got {len(text)}: {text[:20]!r}")
        keys, typed = _orientations([one.q for one in keyframes])
        notes = [*self.notes]
        if typed:
            norm = float(np.linalg.norm(keyframes[typed[0]].q))
            others = f", as {len(typed) - 1} more were" if len(typed) > 1 else ""
            notes.append(
                f"keyframes[{typed[0]}].quaternion of norm {norm:.6f} was scaled to norm 1{others}"
            )
            scaled = dict(zip(typed, keys[typed].tolist(), strict=True))
            keyframes = tuple(
                replace(one, q=tuple(scaled[k])) if k in scaled else one
                for k, one in enumerate(keyframes)
            )
        checked: dict[str, Any] = {
            "keyframes": keyframes,
            "notes": _notes(notes) if notes else (),
            "frames": named_frames(self.frames),
            "options": MappingProxyType(dict(self.options)),
            "device_options": MappingProxyType(dict(self.device_options)),
            "keys": keys,
            "times": _times([one.time for one in keyframes]),
            "positions": _positions([one.position for one in keyframes]),
            "turns": _turns([one.turns for one in keyframes]),
        }
        for name in ("start_velocity", "end_velocity", "rate"):
            if getattr(self, name) is not None:
                x, y, z = _numbers(getattr(self, name), 3, name, "three numbers")
                checked[name] = x, y, z
        if len(keyframes) == 1:
            checked["approach"] = True
        # The class is frozen for everybody but its own constructor.
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if len(keyframes) == 1:
            self._check_single()
        self._check_pace()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MotionRequest):
            return NotImplemented
        return is_same(self.given(), other.given())

    def __hash__(self) -> int:
        return hash((self.keyframes, self.method, self.start_velocity, self.end_velocity))

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(MotionRequest, **self.given()), ()

    def __repr__(self) -> str:
        given = self.given()
        keyframes = given.pop("keyframes")
        is_short = len(keyframes) <= _FEW
        said = repr(list(keyframes)) if is_short else f"{len(keyframes)} keyframes"
        if self.times is not None and not is_short:
            said += f" from {self.times[0]:g} s to {self.times[-1]:g} s"
        # Arguments other than their defaults; the method always counts.
        usual: tuple[object, ...] = (None, False, {}, "body", "", "x", ())
        others = [f"{k}={v!r}" for k, v in given.items() if k == "method" or v not in usual]
        return f"MotionRequest({', '.join([said, *others])})"

    def given(self) -> dict[str, Any]:
        """Return what it was made of, by the names of its arguments."""
        made = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.init}
        return {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in made.items()
        }

    @cached_property
    def omega_start(self) -> Floats | None:
        """The start velocity in the body frame of the first keyframe, rad/s."""
        return self._to_body(self.start_velocity, 0)

    @cached_property
    def omega_end(self) -> Floats | None:
        """The end velocity in the body frame of the last keyframe, rad/s."""
        return self._to_body(self.end_velocity, -1)

    @property
    def driver_options(self) -> dict[str, Any]:
        """The device options without ``home``, which is the planner's for any gimbal."""
        return {name: given for name, given in self.device_options.items() if name != "home"}

    @property
    def is_single(self) -> bool:
        """Whether there is one keyframe only, and so no curve to plan beyond the way there."""
        return len(self.keyframes) == 1

    @property
    def is_quickest(self) -> bool:
        """Whether the timing is to be the quickest, or that slowed down."""
        return self.times is None and self.pace != "even"

    @property
    def total(self) -> float | None:
        """The duration in seconds, if one was asked for."""
        return None if isinstance(self.duration, str) else self.duration

    def _check_pace(self) -> None:
        for name, word, most, unit in _PACES:
            value = getattr(self, name)
            is_text = value is None or isinstance(value, str)
            if not (value in (None, word) if is_text else 0.0 < value < math.inf and value <= most):
                raise RequestError(name, f"expected {word!r} or {unit}, got {value!r}")
            if value is not None and self.times is not None:
                raise RequestError(name, "leaves the times to the planner; give none")
        if None not in (self.duration, self.pace) and (self.total is None or self.pace != "even"):
            raise RequestError("pace", "a share of the quickest has its own duration; give one")

    def _check_single(self) -> None:
        if self.times is not None:
            problem = "is reached as quickly as the limits permit; times need another"
            raise RequestError("keyframes[0].time", f"a single keyframe {problem}")
        if self.start_velocity is not None:
            problem = "a single keyframe is the end of a motion: give end_velocity"
            raise RequestError("start_velocity", problem)

    def _to_body(self, velocity: Vector3 | None, index: int) -> Floats | None:
        if velocity is None:
            return None
        omega = np.array(velocity)
        if self.velocity_frame == "body":
            return omega
        return rotate(conjugate(self.keys[index]), omega)


def named_frames(given: Mapping[str, Frame]) -> Mapping[str, Frame]:
    """Return *given* as nobody can change it any more.

    Raises:
        RequestError: there are too many, or a name is none.
    """
    if len(given) > MOST_FRAMES:
        raise RequestError("frames", f"expected at most {MOST_FRAMES}, got {len(given)}")
    for name in given:
        if not _FRAME_NAME.fullmatch(name):
            expected = "expected a letter, then at most 31 letters, digits, '-' or '_'"
            raise RequestError("frames", f"{expected}, got {name!r}")
    return MappingProxyType(dict(given))


def _numbers(row: Any, width: int, name: str, expected: str) -> list[float]:  # noqa: ANN401 - checked here
    """Return *width* finite numbers, of the field *name*."""
    try:
        array = np.asarray(row, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (width,):
        raise RequestError(name, f"expected {expected}, got {row}")
    found: list[float] = array.tolist()
    if not all(map(math.isfinite, found)):
        raise RequestError(name, f"expected finite numbers, got {found}")
    return found


def _table(rows: Sequence[Any], width: int, name: str, expected: str) -> Floats:
    """Return *rows* as an array, naming the first one that is not *width* finite numbers."""
    try:
        table = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError):
        table = np.empty(0)
    if table.shape != (len(rows), width) or not np.isfinite(table).all():
        table = np.array(
            [
                _numbers(row, width, f"keyframes[{index}].{name}", expected)
                for index, row in enumerate(rows)
            ]
        )
    return table


def _orientations(given: Sequence[Any]) -> tuple[Floats, list[int]]:
    """Return unit quaternions, shape (n, 4), and where they were off by more than rounding."""
    keys = _table(given, 4, "quaternion", "four numbers w, x, y, z")
    with np.errstate(over="ignore"):
        norm = np.sqrt(np.sum(keys * keys, axis=-1))
    error = np.abs(norm - 1.0)
    largest = float(error.max())
    if largest > TYPED_NORM_TOLERANCE:
        index = int(np.argmax(error > TYPED_NORM_TOLERANCE))
        raise RequestError(
            f"keyframes[{index}].quaternion",
            f"norm must be 1 within {TYPED_NORM_TOLERANCE:g}, got {norm[index]:.9g}",
        )
    if largest <= ROUNDING:
        return keys, []
    typed = np.flatnonzero(error > NORM_TOLERANCE)
    keys[typed] /= norm[typed, None]
    return check_unit(keys), typed.tolist()


def _notes(given: Sequence[Any]) -> tuple[str, ...]:
    """Return lines for the certificate, checked."""
    if isinstance(given, str) or len(given) > MOST_NOTES:
        raise RequestError("notes", f"expected at most {MOST_NOTES} lines")
    for index, line in enumerate(given):
        if not (isinstance(line, str) and len(line) <= LONGEST_NOTE and line.isprintable()):
            expected = f"expected at most {LONGEST_NOTE} printable characters"
            raise RequestError(f"notes[{index}]", f"{expected}, got {str(line)[:20]!r}")
    return tuple(given)


def _times(given: Sequence[Any]) -> Floats | None:
    """Return times that increase, s, shape (n,); ``None`` where no keyframe has one."""
    if given.count(None) == len(given):
        return None
    if None in given:
        index = given.index(None) if given[0] is not None else 0
        other = next(i for i, time in enumerate(given) if time is not None)
        raise RequestError(
            f"keyframes[{index}].time",
            f"missing: keyframes[{other}] has one, so every keyframe needs one (or none)",
        )
    seconds = _table([(time,) for time in given], 1, "time", "a number of seconds")[:, 0]
    steps = np.diff(seconds)
    if np.any(steps <= 0.0):
        index = int(np.argmax(steps <= 0.0)) + 1
        now, before = seconds[index], seconds[index - 1]
        raise RequestError(
            f"keyframes[{index}].time",
            f"{now:.9g} s is the time of keyframes[{index - 1}] too: an interval of length zero"
            if now == before
            else f"must be later than keyframes[{index - 1}] at {before:.9g} s, got {now:.9g} s",
        )
    return seconds


def _positions(given: Sequence[Any]) -> Floats | None:
    """Return positions, m, shape (n, 3), NaN where a keyframe has none; ``None`` without any."""
    if all(position is None for position in given):
        return None
    places = np.full((len(given), 3), math.nan)
    for index, position in enumerate(given):
        if position is None:
            continue
        name = f"keyframes[{index}].position"
        places[index] = _numbers(position, 3, name, "three numbers")
        farthest = float(np.max(np.abs(places[index])))
        if farthest > FARTHEST:
            raise RequestError(name, f"expected at most {FARTHEST:g} m, got {farthest:g} m")
    return places


def _turns(given: Sequence[Any]) -> Turns:
    """Return whole turns beyond the short way, shape (n,)."""
    if given.count(0) == len(given) and set(map(type, given)) == {int}:
        return np.zeros(len(given), dtype=np.int64)
    for index, count in enumerate(given):
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)):
            raise RequestError(f"keyframes[{index}].turns", f"expected whole turns, got {count!r}")
        if abs(int(count)) > MOST_TURNS:
            raise RequestError(
                f"keyframes[{index}].turns", f"expected at most {MOST_TURNS} turns, got {count}"
            )
    if given[0] and len(given) > 1:
        raise RequestError(
            "keyframes[0].turns", f"there is no keyframe before the first, got {given[0]} turns"
        )
    return np.array(given, dtype=np.int64)
