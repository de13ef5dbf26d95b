"""From a deployment's options to the gimbal that plans are made for.

The driver answers every orientation by the nearest axis angles, so what is planned here comes out
at the servos as it was planned, as long as the orientations streamed are those of the plan
(:attr:`.AxisPath.q`) and the plan began where the gimbal is commanded to be.
"""

from __future__ import annotations

from math import degrees

import numpy as np

from orientd.driver import Vector3
from orientd.rotation import conjugate, rotate
from orientd_dynamixel.certificate import AxisCertificate, AxisLimits
from orientd_dynamixel.kinematics import Gimbal
from orientd_dynamixel.options import GimbalOptions


def gimbal_of(options: GimbalOptions) -> Gimbal:
    """Return the gimbal that *options* describe."""
    return Gimbal(options.order, options.mount, options.tool)


def pointed(
    options: GimbalOptions, direction: Vector3, axis: str
) -> tuple[float, float, float, float] | None:
    """Return the orientation that points there with the innermost of three axes at zero.

    Args:
        options: of the deployment.
        direction: in the world.
        axis: of the tool.

    Returns:
        ``None`` where there are two axes, or the innermost one is not what points.
    """
    gimbal = gimbal_of(options)
    inner = np.eye(3)[gimbal.inner_axis]
    points = rotate(np.array(gimbal.tool), np.eye(3)["xyz".index(axis)])
    if len(gimbal.axes) == 2 or float(points @ inner) < 1.0 - 1e-9:
        return None
    matrix = np.zeros((3, 3))
    matrix[:, gimbal.inner_axis] = rotate(conjugate(np.array(gimbal.mount)), direction)
    outer, _ = gimbal.pointing(matrix)
    middle = gimbal.rest(matrix, outer).inner[..., 0]
    w, x, y, z = gimbal.forward([float(outer), float(middle), 0.0]).tolist()
    return (w, x, y, z)


def limits_of(options: GimbalOptions) -> list[AxisLimits]:
    """Return what each axis may do."""
    return [
        AxisLimits(axis.low, axis.high, axis.velocity, axis.acceleration, axis.name)
        for axis in options.axes
    ]


def describe(certificate: AxisCertificate, options: GimbalOptions) -> list[str]:
    """Return the certificate in words, a line each, for people."""
    lines = described(certificate, options)
    error = certificate.error
    outside = " outside slews" if certificate.slews else ""
    lines.append(
        f"the path is missed by at most {degrees(error.value):.4f} deg{outside} at "
        f"{error.time:.3f} s"
    )
    lines += [
        f"{hole.start:.3f} to {hole.end:.3f} s: {hole.kind} near the pole, missing by at most "
        f"{degrees(hole.error):.3f} deg"
        for hole in certificate.keyholes
    ]
    for slew in certificate.slews:
        goal = ", ".join(f"{degrees(angle):.1f}" for angle in slew.after)
        what = "goes on slowly" if slew.is_on_path else "stops and the axes slew"
        off = f", off it by up to {degrees(slew.error):.1f} deg"
        lines.append(
            f"{slew.start:.3f} to {slew.end:.3f} s ({slew.duration:.2f} s): the path {what} to "
            f"{goal} deg{off}"
        )
    return lines


def described(certificate: AxisCertificate, options: GimbalOptions) -> list[str]:
    """Return what the axes do in words, a line each."""
    lines = []
    for number, axis in enumerate(options.axes):
        speed, force = certificate.velocity[number], certificate.acceleration[number]
        low, high = certificate.travel[number]
        lines.append(
            f"{axis.name}: {_tenths(low)} to {_tenths(high)} deg, at most "
            f"{degrees(speed.value):.1f} deg/s at {speed.time:.3f} s (limit "
            f"{degrees(speed.limit):.1f}), {degrees(force.value):.0f} deg/s^2 at {force.time:.3f} s"
        )
    return lines


def _tenths(angle: float) -> str:
    """Return an angle in degrees with one decimal, and no sign of a zero."""
    return f"{round(degrees(angle), 1) + 0.0:.1f}"
