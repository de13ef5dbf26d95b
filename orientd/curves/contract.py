"""The contract of every curve on the rotation group, and the families by name.

A family implements two methods.  :meth:`Curve._solve` makes a curve from its parameters, and
:meth:`Curve._orientations` evaluates it.  Shared code is here: names and checks of common
parameters, evaluation, equality.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from importlib import import_module
from inspect import Parameter, Signature
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.keyframes import (
    STATE_ENDS,
    VELOCITY_ENDS,
    EndState,
    check_aligned,
    check_end,
    check_integer,
    check_interval,
    check_quaternion,
    is_same,
    resolve_knots,
    resolve_times,
)
from orientd.curves.roles import Family, own_names
from orientd.curves.trajectory import Samples, Trajectory
from orientd.errors import OrientdError
from orientd.rotation import Floats, to_scipy, unnamed

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""Tolerance of the domain, relative to its larger end, for times that are out by rounding."""

_AS_THEY_ARE = (float, int, str, bool, type(None))

_FEW = 8
"""Largest array that an error shows in full."""

FREE: EndState = (None, None)
Ends = tuple[EndState, EndState]

NEEDED = Parameter.empty
"""Marks a parameter without a default."""

SHARED = {
    "keys": "unit quaternions ``(w, x, y, z)``, at least two.",
    "times": 'instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.',
    "control": "control quaternions ``(w, x, y, z)``, at least two.",
    "order": "degree plus one, at least 2, and at most the number of control quaternions.",
    "knots": (
        "non-decreasing instants in seconds, *order* more than control quaternions; without them\n"
        "            a second apart, and the curve starts at 0.  Its domain is\n"
        "            ``[knots[order - 1], knots[-order]]``."
    ),
    "q0": "first orientation.",
    "q1": "last orientation.",
    "t0": "first instant, s.",
    "t1": "last instant, s.",
    "start": "condition at the first keyframe.",
    "end": "condition at the last keyframe.",
    "omega_start": "body angular velocity at the first keyframe, rad/s.",
    "omega_end": "body angular velocity at the last keyframe, rad/s.",
    "alpha_start": "body angular acceleration at the first keyframe, rad/s^2.",
    "alpha_end": "body angular acceleration at the last keyframe, rad/s^2.",
    "omega0": "angular velocity at *t0*, rad/s, in *frame*.",
    "omega1": "angular velocity at *t1*, rad/s, in *frame*.",
    "frame": '``"body"`` or ``"world"``: what velocities and accelerations are given in.',
    "align": "whether each quaternion takes the sign nearer to its predecessor.",
}
"""Parameters that many families share, with the text for their docstrings."""


class Curve(Family):
    """A curve of orientations over a time interval.

    A family takes the keyword arguments named in :attr:`takes`.  Every family also takes ``keys``,
    ``times`` (``None`` for chord length), ``start_velocity`` and ``end_velocity`` (rad/s, in
    ``velocity_frame``), and ``turns`` (whole turns in each interval). :mod:`orientd.curves.roles`
    defines their meaning for a family.  Orientations may be ``Rotation``,
    :class:`~orientd.rotation.Quaternion` or arrays ``(w, x, y, z)``.

    Two curves are equal if they have the same family and parameters.

    Attributes:
        continuity: number of continuous derivatives of the orientation at the knots for the given
            parameters: 0, 1 or 2.  A single segment has no inner knots and reports 2.
        made_of: the parameters by the family's own names; do not change them.
        shared: the parameters that families of one kind share, with their defaults.
        own: parameters of this family only.
    """

    continuity: int
    made_of: Mapping[str, Any] = MappingProxyType({})
    shared: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    own: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    _defaults: ClassVar[Mapping[str, Any]]
    _ends: Ends = (FREE, FREE)

    def __init_subclass__(cls) -> None:
        """Declare the parameters of a family, and complete its docstring with the shared ones."""
        super().__init_subclass__()
        kind = Parameter.KEYWORD_ONLY
        defaults = {**cls.shared, **cls.own}
        taken = [Parameter(name, kind, default=default) for name, default in defaults.items()]
        taken.sort(key=lambda parameter: parameter.name == "align")
        cls.takes = tuple(parameter.name for parameter in taken)
        cls.__signature__ = Signature(taken)  # type: ignore[attr-defined]
        cls._defaults = {name: one for name, one in defaults.items() if one is not NEEDED}
        if "name" in vars(cls) and cls.__doc__:
            cls.__doc__ = _described(cls.__doc__, cls.takes)

    def __init__(self, **given: Any) -> None:  # noqa: ANN401 - of any family
        for name, value in given.items():
            if not isinstance(value, np.ndarray) and type(value) not in _AS_THEY_ARE:
                given[name] = unnamed(value)
        if not given.keys() <= set(self.takes):
            given = own_names(type(self), given)
        self._make(**{**self._defaults, **given})
        self.made_of = {name: _kept(value) for name, value in given.items()}

    def _make(self, *args: Any, **given: Any) -> None:  # noqa: ANN401
        """Check the parameters that a kind of family shares, and solve for the curve."""
        raise NotImplementedError

    def _solve(self, *args: Any, **given: Any) -> None:  # noqa: ANN401
        """Compute the data of :meth:`_orientations` and set the knots; families implement this."""
        raise NotImplementedError

    def _orientations(self, times: Floats) -> Floats:
        """Return quaternions of either sign at *times* inside the domain, shape ``(n, 4)``.

        Velocities and accelerations are derived from them.
        """
        raise NotImplementedError

    def _set_knots(self, knots: ArrayLike, continuity: int) -> None:
        """Set the break points of the curve, domain ends included, and its continuity there."""
        self._knots: Floats = np.array(knots, dtype=np.float64)
        self._knots.setflags(write=False)
        self._start, self._end = float(self._knots[0]), float(self._knots[-1])
        self._slack = ROUNDING * max(abs(self._start), abs(self._end))
        self.continuity = min(continuity, 2)

    @property
    def knots(self) -> Floats:
        """The times at which the formula changes, and both ends, increasing, in seconds."""
        return self._knots

    def plot(self, *_: object, **__: object) -> None:
        """Say which function draws a curve; version 0.2 drew it here.

        Raises:
            OrientdError: always.
        """
        raise OrientdError("curve.plot(path) is now orientd.plots.draw(curve, path)")

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last time of the curve, in seconds."""
        return self._start, self._end

    def evaluate(self, times: ArrayLike, *, out: Floats | None = None) -> Samples:
        """Return orientation, body angular velocity and body angular acceleration.

        At a knot the values belong to the segment that begins there, and at the end of the domain
        to the last segment.

        Args:
            times: in seconds inside :attr:`domain`, any shape, in any order; increasing times are
                fastest.
            out: a C-contiguous float64 array of shape ``(10, n)`` to fill, *n* the number of times:
                four rows of orientation, three of angular velocity, three of angular acceleration.
                The returned arrays are views of it.  By default they are new.

        Returns:
            Quaternions ``(..., 4)`` scalar first, with continuous sign along the curve;
            angular velocity ``2 vec(q* q')`` in rad/s in the body frame, ``(..., 3)``; its rate
            in rad/s^2 in the body frame, ``(..., 3)``; leading axes as in *times*.

        Raises:
            ValueError: a time is outside the domain (apart from rounding) or NaN, or *out* does not
                fit.
        """
        instants = np.asarray(times, dtype=np.float64)
        flat = self._inside(instants.reshape(-1))
        if out is not None and (
            out.shape != (10, flat.size) or out.dtype != np.float64 or not out.flags.carray
        ):
            raise ValueError(
                "out must be a writable C-contiguous float64 array of shape "
                f"(10, {flat.size}), got {out.dtype} of shape {out.shape}"
            )
        q, omega_body, alpha_body = self.trajectory.sample(flat, out)
        if instants.ndim == 1:
            return q, omega_body, alpha_body
        shape = instants.shape
        return q.reshape(*shape, 4), omega_body.reshape(*shape, 3), alpha_body.reshape(*shape, 3)

    def __call__(self, times: ArrayLike) -> Rotation:
        """Return the orientations at *times* (s, one or a row) as a SciPy ``Rotation``.

        Raises:
            ValueError: an instant is outside the domain or not a number.
            OrientdError: SciPy is not installed.
        """
        return to_scipy(self.evaluate(times)[0])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Curve):
            return NotImplemented
        return type(self) is type(other) and is_same(self.made_of, other.made_of)

    def __hash__(self) -> int:
        return hash((type(self), self.domain, len(self._knots)))

    def __repr__(self) -> str:
        start, end = self.domain
        parts = [f"{start:g} s to {end:g} s", f"C{self.continuity}"]
        parts += [f"{name}={_in_short(value)}" for name, value in self.made_of.items()]
        return f"<{type(self).__name__}: {', '.join(parts)}>"

    def ends(self) -> Samples:
        """Return the result of :meth:`evaluate` at both ends of the domain."""
        return self.evaluate(np.array(self.domain))

    @cached_property
    def trajectory(self) -> Trajectory:
        """The table of the curve for sampling, fitted on first use."""
        fitted = Trajectory.fit(self._orientations, self._knots, continuity=self.continuity)
        return fitted.pinned(*self._ends)

    def _inside(self, times: Floats) -> Floats:
        """Return *times* clipped to the domain if they are out by rounding; refuse others."""
        is_outside = ~((times >= self._start - self._slack) & (times <= self._end + self._slack))
        if is_outside.any():
            worst = float(times[int(np.argmax(is_outside))])
            raise ValueError(
                f"times must be in the domain [{self._start!r}, {self._end!r}] s, got {worst!r}"
            )
        clipped: Floats = np.clip(times, self._start, self._end)
        return clipped

    def _shares(self, times: Floats) -> tuple[np.ndarray[tuple[int], np.dtype[np.intp]], Floats]:
        """Return the knot span of each time, and the place in it; the last span is closed."""
        span: np.ndarray[tuple[int], np.dtype[np.intp]] = np.searchsorted(
            self._knots[1:-1], times, side="right"
        )
        begin = self._knots[span]
        return span, (times - begin) / (self._knots[span + 1] - begin)


class Between(Curve):
    """A curve between two orientations; ``_solve`` gets both and the interval."""

    interpolates = True
    shared: ClassVar[Mapping[str, Any]] = {"q0": NEEDED, "q1": NEEDED, "t0": 0.0, "t1": 1.0}

    def _make(self, q0: object, q1: object, t0: object, t1: object, **own: object) -> None:
        ends = check_quaternion(q0, "q0"), check_quaternion(q1, "q1")
        self._solve(*ends, check_interval(t0, t1), **own)


class Drawn(Curve):
    """A curve from control quaternions; ``_solve`` gets them checked and aligned."""

    shared: ClassVar[Mapping[str, Any]] = {"control": NEEDED, "align": True}

    def _make(self, control: object, align: object, **own: object) -> None:
        self._solve(check_aligned(control, align, "control"), **own)


class DrawnOverKnots(Curve):
    """A curve of a given order over knots; ``_solve`` gets control quaternions, order and knots."""

    shared: ClassVar[Mapping[str, Any]] = {**Drawn.shared, "order": 4, "knots": None}

    def _make(self, control: object, align: object, order: object, knots: object) -> None:
        size = check_integer(order, "order", minimum=2)
        points = check_aligned(control, align, "control", minimum=size)
        self._solve(points, size, resolve_knots(knots, len(points), size))


class Through(Curve):
    """A curve through keyframes; ``_solve`` gets them checked and aligned, with their times."""

    interpolates = True
    fewest: ClassVar[int] = 2
    shared: ClassVar[Mapping[str, Any]] = {"keys": NEEDED, "times": None, "align": True}

    def _make(
        self,
        keys: object,
        times: object,
        align: object,
        **own: Any,  # noqa: ANN401 - of any family
    ) -> None:
        q = check_aligned(keys, align, minimum=self.fewest)
        self._aligns = bool(align)
        self._solve(q, resolve_times(times, q, own.get("turns")), **own)


class WithEndVelocities(Through):
    """A curve through keyframes with end conditions, which ``_solve`` gets last."""

    meets_end_velocities = True
    conditions: ClassVar[Mapping[str, tuple[int, int]]] = VELOCITY_ENDS
    shared: ClassVar[Mapping[str, Any]] = {
        **Through.shared,
        **dict.fromkeys(("start", "end"), "natural"),
        **dict.fromkeys(("omega_start", "omega_end")),
    }

    def _make(
        self,
        keys: object,
        times: object,
        align: object,
        **own: Any,  # noqa: ANN401 - of any family
    ) -> None:
        ends = []
        for side in ("start", "end"):
            names = side, f"omega_{side}", f"alpha_{side}"
            condition, omega, alpha = (own.pop(name, None) for name in names)
            ends.append(check_end(side, condition, omega, alpha, self.conditions))
        self._ends = prescribed((ends[0], ends[1]))
        super()._make(keys, times, align, ends=tuple(ends), **own)


def prescribed(ends: Ends) -> Ends:
    """Return the conditions at both ends: a free end has zero acceleration."""
    free = None, np.zeros(3)
    return free if ends[0][0] is None else ends[0], free if ends[1][0] is None else ends[1]


class WithEndStates(WithEndVelocities):
    """A curve through keyframes whose ends may also have accelerations."""

    conditions = STATE_ENDS
    shared: ClassVar[Mapping[str, Any]] = {
        **WithEndVelocities.shared,
        "alpha_start": None,
        "alpha_end": None,
    }


def _described(text: str, takes: tuple[str, ...]) -> str:
    """Return the docstring of a family with its shared parameters added."""
    text, _, errors = text.rstrip().partition("\n\n    Raises:\n")
    text, _, own = text.partition("\n\n    Args:\n")
    entries = [
        f"        {name}: {SHARED[name]}"
        for name in takes
        if name in SHARED and f"        {name}: " not in own
    ]
    entries += [own] if own else []
    raised = ["        ValueError: a parameter is not as said.", errors]
    return "\n".join([text, "", "    Args:", *entries, "", "    Raises:", *raised])


def _kept(value: object) -> object:
    """Return an immutable parameter."""
    if isinstance(value, list | tuple):
        value = np.array(value)
    elif isinstance(value, np.ndarray):
        value = value.copy()
    else:
        return value
    value.setflags(write=False)
    return value


def _in_short(value: object) -> str:
    """Return a short text of a parameter."""
    if not isinstance(value, np.ndarray) or value.size <= _FEW:
        return repr(value.tolist() if isinstance(value, np.ndarray) else value)
    return f"array of shape {value.shape}"


_HOMES = {
    "slerp": ("products", "Slerp"),
    "piecewise_slerp": ("products", "PiecewiseSlerp"),
    "kks_bezier": ("products", "KksBezier"),
    "kks_hermite": ("hermite", "KksHermite"),
    "kks_quintic_hermite": ("hermite", "KksQuinticHermite"),
    "kks_hermite_spline": ("hermite", "KksHermiteSpline"),
    "kks_bspline": ("products", "KksBspline"),
    "kks_uniform": ("products", "KksUniform"),
    "c2_cumulative": ("interpolating", "C2Cumulative"),
    "kks_interpolating": ("interpolating", "KksInterpolating"),
    "squad": ("triangles", "Squad"),
    "de_casteljau": ("triangles", "DeCasteljau"),
    "shoemake_bezier": ("triangles", "ShoemakeBezier"),
    "bezier_catmull_rom": ("triangles", "BezierCatmullRom"),
    "schlag_catmull_rom": ("triangles", "SchlagCatmullRom"),
    "schlag_bspline": ("triangles", "SchlagBSpline"),
    "circular_blending": ("sphere", "CircularBlending"),
    "nielson_shieh": ("inner_points", "NielsonShieh"),
    "spherical_quadratic": ("inner_points", "SphericalQuadratic"),
    "nielson_heiland": ("sphere", "NielsonHeiland"),
    "normalized_cubic": ("sphere", "NormalizedCubic"),
    "nu_spline": ("sphere", "NuSpline"),
    "rotation_vector_spline": ("rotation_vector", "RotationVectorSpline"),
    "min_acceleration": ("min_acceleration", "MinAcceleration"),
    "minimum_effort": ("minimum_effort", "MinimumEffort"),
}
"""Module and class of each family in this package."""


class Families(Mapping[str, type[Curve]]):
    """The classes of all families by name, each imported on first use."""

    def __getitem__(self, name: str) -> type[Curve]:
        return _family(*_HOMES[name])

    def __contains__(self, name: object) -> bool:
        return name in _HOMES

    def __iter__(self) -> Iterator[str]:
        return iter(_HOMES)

    def __len__(self) -> int:
        return len(_HOMES)


@cache
def _family(home: str, written_as: str) -> type[Curve]:
    family: type[Curve] = getattr(import_module(f"orientd.curves.{home}"), written_as)
    return family


METHODS: Mapping[str, type[Curve]] = Families()
"""Every family by its name, imported on first use."""
