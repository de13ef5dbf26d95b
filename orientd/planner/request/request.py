"""What a planner is asked for: keyframes, velocities at the ends, limits, and where to start.

Every value is checked when it is made, so that a request that exists is well formed whether it
came from a file, from a socket or from Python; :class:`~orientd.errors.RequestError` names the
field.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves import is_same
from orientd.errors import RequestError
from orientd.planner.limits import Limits
from orientd.planner.request import columns
from orientd.planner.request.columns import Turns, Vector3
from orientd.planner.request.frames import Frame, named_frames
from orientd.rotation import Floats, check_unit, conjugate, rotate

_FEW = 3
"""Keyframes that a request may have to be shown in full."""

LONGEST_NAME = 80
"""Characters."""

DEFAULT_METHOD = "c2_cumulative"
"""The family of curves of a request that names none."""

Quaternion = tuple[float, float, float, float]
"""``(w, x, y, z)`` of norm 1, tool to world."""
VelocityFrame = Literal["body", "world"]
Duration = Literal["minimum"]
Pace = Literal["even"]
PointingAxis = Literal["x", "y", "z"]
_PACES = ("duration", "minimum", math.inf, "seconds"), ("pace", "even", 1.0, "a share up to 1")


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
        if len(keyframes) == 1:
            self._check_single(keyframes[0])
            object.__setattr__(self, "approach", True)
        frame = self.velocity_frame
        if frame not in ("body", "world"):
            raise RequestError("velocity_frame", f"expected 'body' or 'world', got {frame!r}")
        if self.pointing_axis not in ("x", "y", "z"):
            raise RequestError("pointing_axis", f"expected x, y or z, got {self.pointing_axis!r}")
        named = {f"keyframes[{k}].name": one.name for k, one in enumerate(keyframes) if one.name}
        for name, text in {"name": self.name, **named}.items():
            if len(text) > LONGEST_NAME or not text.isprintable():
                expected = f"expected at most {LONGEST_NAME} printable characters"
                raise RequestError(name, f"{expected}, got {len(text)}: {text[:20]!r}")
        for name in ("start_velocity", "end_velocity", "rate"):
            velocity = getattr(self, name)
            if velocity is not None:
                object.__setattr__(self, name, columns.vector(velocity, name))
        keys, typed = columns.orientations([one.q for one in keyframes])
        notes = [*self.notes]
        if typed:
            notes += _scaled_notes(keyframes, typed)
            keyframes = _scaled(keyframes, keys, typed)
        # The class is frozen for everybody but its own constructor.
        object.__setattr__(self, "keyframes", keyframes)
        object.__setattr__(self, "notes", columns.notes(notes))
        for name in ("options", "device_options"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "frames", named_frames(self.frames))
        object.__setattr__(self, "keys", keys)
        object.__setattr__(self, "times", columns.times([one.time for one in keyframes]))
        self._check_pace()
        object.__setattr__(
            self, "positions", columns.positions([one.position for one in keyframes])
        )
        object.__setattr__(self, "turns", columns.turns([one.turns for one in keyframes]))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MotionRequest):
            return NotImplemented
        return is_same(self.given(), other.given())

    def __hash__(self) -> int:
        return hash((self.keyframes, self.method, self.start_velocity, self.end_velocity))

    def __reduce__(self) -> tuple[Any, ...]:
        return _request, (self.given(),)

    def __repr__(self) -> str:
        few = len(self.keyframes) <= _FEW
        count = f"{len(self.keyframes)} keyframes"
        parts = [repr(list(self.keyframes)) if few else count]
        if self.times is not None and not few:
            parts[0] += f" from {self.times[0]:g} s to {self.times[-1]:g} s"
        parts += [
            f"{entry.name}={getattr(self, entry.name)!r}"
            for entry in fields(self)
            if entry.init and entry.name != "keyframes" and self._is_said(entry.name)
        ]
        return f"MotionRequest({', '.join(parts)})"

    def given(self) -> dict[str, Any]:
        """Return what it was made of, by the names of its arguments."""
        made = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.init}
        return {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in made.items()
        }

    def _is_said(self, name: str) -> bool:
        """Return whether an argument is other than its default; the method always counts."""
        usual: tuple[object, ...] = (None, False, {}, "body", "", "x", ())
        return name == "method" or getattr(self, name) not in usual

    @cached_property
    def omega_start(self) -> Floats | None:
        """The start velocity in the body frame of the first keyframe, rad/s."""
        return self._to_body(self.start_velocity, 0)

    @cached_property
    def omega_end(self) -> Floats | None:
        """The end velocity in the body frame of the last keyframe, rad/s."""
        return self._to_body(self.end_velocity, -1)

    @property
    def is_single(self) -> bool:
        """Whether there is one keyframe only, and so no curve to plan beyond the way there."""
        return len(self.keyframes) == 1

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

    @property
    def is_quickest(self) -> bool:
        """Whether the timing is to be the quickest, or that slowed down."""
        return self.times is None and self.pace != "even"

    @property
    def total(self) -> float | None:
        """The duration in seconds, if one was asked for."""
        return None if isinstance(self.duration, str) else self.duration

    def _check_single(self, keyframe: Keyframe) -> None:
        if keyframe.time is not None:
            raise RequestError(
                "keyframes[0].time",
                "a single keyframe is reached as quickly as the limits permit; times need another",
            )
        if self.start_velocity is not None:
            raise RequestError(
                "start_velocity", "a single keyframe is the end of a motion: give end_velocity"
            )

    def _to_body(self, velocity: Vector3 | None, index: int) -> Floats | None:
        if velocity is None:
            return None
        omega = np.array(velocity)
        if self.velocity_frame == "body":
            return omega
        return rotate(conjugate(self.keys[index]), omega)


def _scaled(
    keyframes: tuple[Keyframe, ...], keys: Floats, places: list[int]
) -> tuple[Keyframe, ...]:
    """Return keyframes, those at *places* with the unit quaternions that they became."""
    scaled = list(keyframes)
    for place in places:
        w, x, y, z = keys[place].tolist()
        scaled[place] = replace(keyframes[place], q=(w, x, y, z))
    return tuple(scaled)


def _scaled_notes(keyframes: tuple[Keyframe, ...], places: list[int]) -> list[str]:
    norm = float(np.linalg.norm(keyframes[places[0]].q))
    others = f", as {len(places) - 1} more were" if len(places) > 1 else ""
    return [f"keyframes[{places[0]}].quaternion of norm {norm:.6f} was scaled to norm 1{others}"]


def _request(given: Mapping[str, Any]) -> MotionRequest:
    return MotionRequest(**given)
