"""A motion's path as the axes follow it, with what the certificate says of it."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, inf
from typing import cast

import numpy as np

from orientd.driver import Figure, Quaternion, ShapedPath, Vector3
from orientd.errors import LimitError, LimitKind
from orientd.rotation import angle
from orientd_dynamixel.certificate import AxisPath, DeviationPolicy, ToolLimits
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.path import as_driven, plan_axes
from orientd_dynamixel.planning import describe, described, gimbal_of, limits_of
from orientd_dynamixel.tracker import AxisTracker
from orientd_dynamixel.ways import way


def shape(
    options: GimbalOptions,
    period: float,
    orientations: Sequence[Quaternion],
    joints: tuple[float, ...],
    before: Sequence[tuple[float, ...]] = (),
    rates: Vector3 = (inf, inf, inf),
    free: float = 0.0,
) -> ShapedPath:
    """Return the path that the gimbal will follow.

    The axes start on the branch and turn that they are on.  Where they start exactly is what the
    driver makes of the first orientation, which may differ from *joints* by what the servos lag.

    Args:
        options: of the deployment.
        period: of the grid, s.
        orientations: up to their rest.
        joints: axis angles planned or reported where the path begins, rad; empty where they are
            not known.
        before: axis angles planned for the periods before, where it begins in motion.
        rates: largest velocity, acceleration and jerk of the tool off the path or its times.
        free: up to which time the path may stand while the outer axis turns at the pole, s.

    Raises:
        LimitError: an axis cannot follow, or a gimbal of two axes leaves too much roll.
        StartError: the gimbal cannot be where the path begins.
    """
    tracker = AxisTracker(options.order, options.mount, options.tool, is_pointing=options.pointing)
    start = None
    if joints:
        tracker.angles = joints
        w, x, y, z = map(float, orientations[0])
        start = tracker.solve((w, x, y, z))[0]
    policy = DeviationPolicy(options.max_deviation, options.allow_slews, free)
    path = plan_axes(
        gimbal_of(options), orientations, period, limits_of(options), start=start, before=before,
        policy=policy,
        tool=ToolLimits(*rates),
    )  # fmt: skip
    origin = path.angles[0] if start is None else start
    past = np.array(before) if len(before) else path.angles[[0, 0]]
    path = as_driven(gimbal_of(options), path, origin, period, limits_of(options), past)
    figures = _figures(path, options)
    if len(options.axes) == 2 and not options.pointing:
        figures.append(_roll(path, orientations, period, options.roll_tolerance))
    return _shaped(path, options, figures, describe(path.certificate, options))


def along(
    options: GimbalOptions,
    joints: tuple[float, ...],
    q: Quaternion,
    *,
    period: float,
    rates: Vector3,
    least: float,
    is_homing: bool,
) -> ShapedPath | None:
    """Return the way of the axes from *joints* to *q*, or home; see :meth:`.Driver.way`."""
    path = way(options, joints, q, period=period, rates=rates, least=least, is_homing=is_homing)
    if path is None:
        return None
    goal = ", ".join(f"{degrees(angle):.1f}" for angle in path.angles[-1])
    notes = [f"all axes turn together to {goal} deg", *described(path.certificate, options)]
    return _shaped(path, options, _figures(path, options), notes)


def _shaped(
    path: AxisPath, options: GimbalOptions, figures: list[Figure], notes: list[str]
) -> ShapedPath:
    # Arrays, which are sequences too: a long path is ten thousands of rows.
    return ShapedPath(
        cast("Sequence[Quaternion]", path.q),
        cast("Sequence[float]", path.path_times),
        cast("Sequence[tuple[float, ...]]", path.angles),
        tuple(figures),
        tuple(notes),
        tuple((axis.velocity, axis.acceleration) for axis in options.axes),
    )


def _figures(path: AxisPath, options: GimbalOptions) -> list[Figure]:
    promised = path.certificate
    figures = []
    for number, axis in enumerate(options.axes):
        speed, force = promised.velocity[number], promised.acceleration[number]
        low, high = promised.travel[number]
        figures += [
            Figure(f"velocity of {axis.name}", speed.value, "rad/s", speed.limit, speed.time),
            Figure(f"acceleration of {axis.name}", force.value, "rad/s^2", force.limit, force.time),
            Figure(f"least angle of {axis.name}", low, "rad", axis.low),
            Figure(f"largest angle of {axis.name}", high, "rad", axis.high),
        ]
    error = promised.error
    figures.append(Figure("pointing error", error.value, "rad", options.max_deviation, error.time))
    if promised.slews:
        worst = max(promised.slews, key=lambda slew: slew.error)
        figures += [
            Figure("pointing error in slews", worst.error, "rad", None, worst.start),
            Figure("time in slews", sum(slew.duration for slew in promised.slews), "s"),
        ]
    figures.append(Figure("manipulability", promised.manipulability, "1"))
    return figures


def _roll(
    path: AxisPath, orientations: Sequence[Quaternion], period: float, tolerance: float
) -> Figure:
    """Return by how much two axes miss orientations, which have three degrees of freedom.

    Raises:
        LimitError: by more than *tolerance*.
    """
    asked = np.asarray(orientations, dtype=np.float64)
    missed = angle(path.q, asked[np.rint(path.path_times / period).astype(np.int64)])
    at = int(np.argmax(missed))
    value, time = float(missed[at]), float(path.times[at])
    if value > tolerance:
        raise LimitError(
            "orientation error of the two axes", value, tolerance, time, "rad",
            f"at most {degrees(tolerance):.2f} deg are allowed; `pointing = true` follows the "
            "direction alone", kind=LimitKind.DEVIATION,
        )  # fmt: skip
    return Figure("orientation error", value, "rad", tolerance, time)
