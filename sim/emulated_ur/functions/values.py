"""Functions of URScript that only calculate: numbers, lists, strings and poses."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

from emulated_ur.arm import (
    from_pose,
    inverse,
    moved,
    multiply,
    rotated,
    rotation_between,
    to_pose,
)  # fmt: skip
from emulated_ur.urscript import Array, Datum, Pose, written


class Values:
    """Functions without a robot.  Angles are in rad, poses in m and rad."""

    acos = staticmethod(math.acos)
    asin = staticmethod(math.asin)
    atan = staticmethod(math.atan)
    atan2 = staticmethod(math.atan2)
    cos = staticmethod(math.cos)
    sin = staticmethod(math.sin)
    tan = staticmethod(math.tan)
    exp = staticmethod(math.exp)
    sqrt = staticmethod(math.sqrt)
    ceil = staticmethod(math.ceil)
    floor = staticmethod(math.floor)
    pow = staticmethod(math.pow)
    d2r = staticmethod(math.radians)
    r2d = staticmethod(math.degrees)
    random = staticmethod(random.random)
    round = staticmethod(round)

    def log(self, b: float, f: float) -> float:
        return math.log(f, b)

    def norm(self, a: Datum) -> float:
        return math.hypot(*a) if isinstance(a, tuple) else abs(a)

    def normalize(self, v: Array) -> Array:
        return v * (1.0 / (math.hypot(*v) or 1.0))

    def length(self, v: Datum) -> int:
        return len(v)

    get_list_length = size = length

    def integer_to_binary_list(self, x: int) -> Array:
        return Array(bool(x >> bit & 1) for bit in range(32))

    def binary_list_to_integer(self, values: Array) -> int:
        return sum(1 << bit for bit, one in enumerate(values) if one)

    # Strings.

    def str_at(self, src: str, index: int) -> str:
        return self.str_sub(src, index, 1)

    def str_cat(self, op1: Datum, op2: Datum) -> str:
        return written(op1) + written(op2)

    def str_empty(self, str: str) -> bool:
        return not str

    def str_find(self, src: str, target: str, start_from: int = 0) -> int:
        return src.find(target, start_from)

    def str_len(self, str: str) -> int:
        return len(str)

    def str_sub(self, src: str, index: int, len: int = -1) -> str:
        if not 0 <= index <= src.__len__():
            raise IndexError(f"index {index} is outside {src!r}")
        return src[index:] if len < 0 else src[index : index + len]

    def to_num(self, str: str) -> float:
        return int(str) if str.strip().lstrip("+-").isdecimal() else float(str)

    def to_str(self, val: Datum) -> str:
        return written(val)

    # Poses.

    def pose_trans(self, p_from: Sequence[float], p_from_to: Sequence[float]) -> Pose:
        return Pose(to_pose(multiply(from_pose(p_from), from_pose(p_from_to))))

    def pose_inv(self, p_from: Sequence[float]) -> Pose:
        return Pose(to_pose(inverse(from_pose(p_from))))

    inv = pose_inv

    def pose_add(self, p_1: Sequence[float], p_2: Sequence[float]) -> Pose:
        return Pose(to_pose(moved(from_pose(p_2), p_1[:3], p_1[3:])))

    def pose_sub(self, p_to: Sequence[float], p_from: Sequence[float]) -> Pose:
        shift = (p_to[0] - p_from[0], p_to[1] - p_from[1], p_to[2] - p_from[2])
        return Pose((*shift, *rotation_between(from_pose(p_from), from_pose(p_to))))

    def pose_dist(self, pose_from: Sequence[float], pose_to: Sequence[float]) -> float:
        return math.hypot(*self.pose_sub(pose_to, pose_from))

    def point_dist(self, p_from: Sequence[float], p_to: Sequence[float]) -> float:
        return math.dist(p_from[:3], p_to[:3])

    def interpolate_pose(self, p_from: Pose, p_to: Pose, alpha: float) -> Pose:
        step = [alpha * one for one in self.pose_sub(p_to, p_from)]
        return Pose(to_pose(moved(from_pose(p_from), step[:3], step[3:])))

    def wrench_trans(self, T_from_to: Pose, w_from: Sequence[float]) -> Array:
        x, y, z = T_from_to[:3]
        fx, fy, fz, mx, my, mz = w_from
        moment = (mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx))
        back = [-one for one in T_from_to[3:]]
        return Array((*rotated((fx, fy, fz), back), *rotated(moment, back)))

    def rpy2rotvec(self, rpy_vector: Sequence[float]) -> Array:
        roll, pitch, yaw = rpy_vector
        about = [from_pose((0, 0, 0, 0, 0, yaw)), from_pose((0, 0, 0, 0, pitch, 0))]
        turned = multiply(multiply(*about), from_pose((0, 0, 0, roll, 0, 0)))
        return Array(to_pose(turned)[3:])

    def rotvec2rpy(self, rotation_vector: Sequence[float]) -> Array:
        rows = from_pose((0, 0, 0, *rotation_vector))
        pitch = math.atan2(-rows[8], math.hypot(rows[0], rows[4]))
        return Array((math.atan2(rows[9], rows[10]), pitch, math.atan2(rows[4], rows[0])))
