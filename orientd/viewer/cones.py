"""The edges of keep-out cones, as the page draws them around the tool."""

from __future__ import annotations

import math
import time
from typing import Any

from orientd.floats import combine, cross, norm
from orientd.protocol import control_pb2 as pb
from orientd.protocol.motion import to_cones

_POINTS = 48


def edges(*messages: pb.KeepOut) -> list[dict[str, Any]]:
    """Return name and edge of each cone now, on a sphere of radius 1 around the tool.

    A later cone of the same name is left out: plans repeat those of the device.
    """
    named = {cone.name: cone for cone in reversed(to_cones(messages))}
    now, found = time.time_ns(), []
    for name, cone in named.items():
        direction = cone.direction_at(now)
        x, y, z = direction
        across = cross(direction, (0.0, 0.0, 1.0) if abs(z) < 0.9 else (1.0, 0.0, 0.0))
        across = combine(across, 1.0 / norm(across), across, 0.0)
        other = cross(direction, across)
        centre, radius = math.cos(cone.half_angle), math.sin(cone.half_angle)
        ring = []
        for k in range(_POINTS + 1):
            turn = 2.0 * math.pi * k / _POINTS
            side = combine(across, radius * math.cos(turn), other, radius * math.sin(turn))
            ring.append([round(one, 4) for one in combine(direction, centre, side, 1.0)])
        found.append({"name": name, "edge": ring, "middle": [x, y, z]})
    return found
