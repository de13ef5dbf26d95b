"""The algebra of unit quaternions: product, exponential, logarithm, slerp, sign alignment.

Quaternions *p* and *q* are ``(w, x, y, z)`` in the last axis, shape ``(..., 4)``.  Vectors have
shape ``(..., 3)``.  Leading axes are broadcast, results are new arrays, and every function raises
:class:`ValueError` for an array whose last axis has another length.

Two scalings of the tangent space live here.  :func:`exp` and :func:`log` take rotation vectors
(the physical angle times the axis).  :func:`exp_half` and :func:`log_half` are the exponential and
the logarithm of the quaternion algebra itself, with half the physical angle (Kim, Kim and Shin,
1995).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orientd.tolerances import NORM_TOLERANCE, ROUNDING

Floats = NDArray[np.float64]

HALF_TURN = 1e-7
"""Dot product of two unit quaternions below which they are half a turn apart.

It allows for quaternions with eight decimals, whose half turns are within 1.2e-5 degrees of 180.
"""

_NO_COMPONENT = 1e-6  # a component of the axis of a half turn
_TINY = 1e-140


def components(values: ArrayLike, length: int, name: str) -> Floats:
    """Return an array of *length* components in its last axis."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != length:
        raise ValueError(
            f"{name} must have {length} components in its last axis, got shape {array.shape}"
        )
    return array


def multiply(p: ArrayLike, q: ArrayLike) -> Floats:
    """Return Hamilton's product of two quaternions.

    The product rotates by *q* first and by *p* second: ``R(pq) = R(p) R(q)`` on column vectors.
    Nielson (1993) prints the last component with the wrong sign of ``q_z r_z``; this is Hamilton's.
    The product is not normalised.
    """
    p = components(p, 4, "p")
    q = components(q, 4, "q")
    pw, px, py, pz = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    qw, qx, qy, qz = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    product: Floats = np.empty(np.broadcast_shapes(p.shape, q.shape))
    product[..., 0] = pw * qw - px * qx - py * qy - pz * qz
    product[..., 1] = pw * qx + px * qw + py * qz - pz * qy
    product[..., 2] = pw * qy - px * qz + py * qw + pz * qx
    product[..., 3] = pw * qz + px * qy - py * qx + pz * qw
    return product


def conjugate(q: ArrayLike) -> Floats:
    """Return the conjugate, which is the inverse of a unit quaternion."""
    opposite: Floats = components(q, 4, "q") * np.array([1.0, -1.0, -1.0, -1.0])
    return opposite


def normalize(q: ArrayLike) -> Floats:
    """Return quaternions scaled to unit norm, with their signs kept.

    Raises:
        ValueError: a norm is zero or not finite.
    """
    q = components(q, 4, "q")
    scale = np.max(np.abs(q), axis=-1, keepdims=True)
    if not np.all(np.isfinite(scale) & (scale > 0.0)):
        raise ValueError("q must be finite and not zero to be normalised")
    scaled = q / scale
    unit: Floats = scaled / np.sqrt(np.sum(scaled * scaled, axis=-1, keepdims=True))
    return unit


def check_unit(q: ArrayLike) -> Floats:
    """Return quaternions normalised; refuse those that are not nearly unit quaternions.

    Quaternions that are unit to rounding stay unchanged, to the last digit.

    Raises:
        ValueError: a component is not finite, or a norm is off by more than 1e-6.
    """
    q = components(q, 4, "q")
    if not np.all(np.isfinite(q)):
        raise ValueError("quaternion components must be finite")
    norm = np.sqrt(np.sum(q * q, axis=-1))
    error = np.abs(norm - 1.0)
    if np.any(error > NORM_TOLERANCE):
        worst = float(norm.flat[int(np.argmax(error))])
        raise ValueError(f"quaternion norm must be 1 within {NORM_TOLERANCE:g}, got {worst:.9g}")
    is_unit = error <= ROUNDING
    unit: Floats = q.copy() if is_unit.all() else np.where(is_unit[..., None], q, normalize(q))
    return unit


def rotate(q: ArrayLike, v: ArrayLike) -> Floats:
    """Return vectors rotated by unit quaternions, the vector part of ``q v q*``."""
    q = components(q, 4, "q")
    v = components(v, 3, "v")
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    vx, vy, vz = v[..., 0], v[..., 1], v[..., 2]
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    rotated: Floats = np.empty((*tx.shape, 3))
    rotated[..., 0] = vx + w * tx + (y * tz - z * ty)
    rotated[..., 1] = vy + w * ty + (z * tx - x * tz)
    rotated[..., 2] = vz + w * tz + (x * ty - y * tx)
    return rotated


def between(p: ArrayLike, q: ArrayLike) -> Floats:
    r"""Return the rotation from one unit quaternion to another, ``p* q``, in the body frame of *p*.

    The result equals :func:`multiply` with the conjugate of *p*, but keeps its relative precision
    if the two are nearly equal or nearly opposite.  The vector part comes from their difference,

    .. math:: \operatorname{vec}(p^* q) = \operatorname{vec}\bigl(p^* (q \mp p)\bigr),

    which is exact in floating point, while the products of the components would cancel.
    """
    p = components(p, 4, "p")
    q = components(q, 4, "q")
    w = np.sum(p * q, axis=-1)
    relative = multiply(conjugate(p), q - np.copysign(1.0, w)[..., None] * p)
    relative[..., 0] = w
    return relative


def exp_half(v: ArrayLike) -> Floats:
    r"""Return the quaternion exponential of pure quaternions.

    .. math:: \exp(v) = (\cos\|v\|,\; \sin\|v\| \; v / \|v\|)

    The rotation has twice the angle :math:`\|v\|` (Kim, Kim and Shin, 1995, sec. 3).
    """
    v = components(v, 3, "v")
    length = np.sqrt(np.sum(v * v, axis=-1))
    q: Floats = np.empty((*v.shape[:-1], 4))
    q[..., 0] = np.cos(length)
    sinc = np.divide(np.sin(length), length, out=np.ones_like(length), where=length > 0.0)
    q[..., 1:] = sinc[..., None] * v
    return q


def log_half(q: ArrayLike) -> Floats:
    r"""Return the principal quaternion logarithm, without changing signs.

    .. math:: \log(q) = \operatorname{atan2}(\|v\|, w) \; v / \|v\|

    No sign is flipped, so the length is in :math:`[0, \pi]` and the physical angle in
    :math:`[0, 2\pi]` (Kim, Kim and Shin, 1995, sec. 3).  The scale of *q* does not matter.
    The logarithm of ``(-1, 0, 0, 0)``, whose axis is not defined, is :math:`(\pi, 0, 0)`.
    """
    q = components(q, 4, "q")
    w, v = q[..., 0], q[..., 1:]
    length = np.sqrt(np.sum(v * v, axis=-1))
    if np.any(length < _TINY):
        # Squares of such small numbers have few digits left, or none.
        length = np.hypot(np.hypot(v[..., 0], v[..., 1]), v[..., 2])
    half_angle = np.arctan2(length, w)
    at_zero = np.divide(1.0, w, out=np.zeros_like(w), where=w > 0.0)
    factor = np.divide(half_angle, length, out=at_zero, where=length > 0.0)
    vector: Floats = factor[..., None] * v
    vector[..., 0] = np.where((length == 0.0) & (w < 0.0), np.pi, vector[..., 0])
    return vector


def exp(rotation_vector: ArrayLike) -> Floats:
    """Return the unit quaternion of a rotation vector: axis times physical angle, rad.

    The vector may have any length.  The scalar part is not negative for angles up to pi.
    """
    return exp_half(0.5 * components(rotation_vector, 3, "rotation_vector"))


def log(q: ArrayLike) -> Floats:
    r"""Return the rotation vector of a unit quaternion.

    Of the rotation vectors of :math:`\pm q` this is the shorter one, so its length is in
    :math:`[0, \pi]`.  The arc tangent, unlike the arc cosine, keeps full relative precision at
    both ends, so no series expansion is needed.

    .. math:: r = 2 \operatorname{atan2}(\|v\|, |w|) \; \operatorname{sgn}(w) \; v / \|v\|

    The scale of *q* does not matter.  For a half turn the axis is ``+v``.
    """
    q = components(q, 4, "q")
    return 2.0 * log_half(np.where(q[..., :1] < 0.0, -q, q))


def power(q: ArrayLike, exponent: ArrayLike) -> Floats:
    """Return a real power of unit quaternions, ``exp_half(exponent * log_half(q))``.

    The signs of *q* are kept.  Exponents are broadcast against the leading axes of *q*.
    """
    return exp_half(np.asarray(exponent, dtype=np.float64)[..., None] * log_half(q))


def slerp(p: ArrayLike, q: ArrayLike, u: ArrayLike) -> Floats:
    r"""Return the point at *u* of the great arc from *p* (``u = 0``) to *q* (``u = 1``).

    .. math:: p \exp(u \log(p^{-1} q))

    The signs of both quaternions are kept: a slerp that flips signs makes every construction built
        from it discontinuous.  *u* may be any real number, since Schlag (1991) needs values outside
        ``[0, 1]``.
    """
    return multiply(p, power(between(p, q), u))


def angle(p: ArrayLike, q: ArrayLike) -> Floats:
    """Return the angle in radians, in ``[0, pi]``, between two orientations, whatever their signs.

    It is twice the angle between two unit vectors.  The arc tangent of their difference and their
    sum is precise for every angle (Kahan 2006, sec. 12).
    """
    p = components(p, 4, "p")
    q = components(q, 4, "q")
    if p.ndim == q.ndim == 1:
        # One pair is the most frequent case; this takes a third of the time.
        one, other = p.tolist(), q.tolist()
        sides = math.dist(one, other), math.dist(one, [-part for part in other])
        return np.float64(4.0 * math.atan2(min(sides), max(sides)))  # type: ignore[return-value]
    apart, along = (np.sqrt(np.einsum("...i,...i->...", v, v)) for v in (q - p, q + p))
    found: Floats = 4.0 * np.arctan2(np.minimum(apart, along), np.maximum(apart, along))
    return found


def nearer_sign(w: float, x: float, y: float, z: float) -> float:
    """Return the sign of a relative quaternion that gives the shorter turn.

    Both ways of a half turn are equally short, so rounding would choose.  A turn within
    :data:`HALF_TURN` of one therefore goes the positive way about the z axis of the body frame.  It
    goes about y if its axis has no z component, and about x if it has neither.

    >>> nearer_sign(0.0, 0.6, 0.0, -0.8), nearer_sign(-1e-9, 0.8, 0.6, 1e-9)
    (-1.0, 1.0)
    """
    if abs(w) > HALF_TURN:
        return math.copysign(1.0, w)
    for component in (z, y, x):
        if abs(component) > _NO_COMPONENT:
            return math.copysign(1.0, component)
    return 1.0


def are_half_turns(qs: ArrayLike) -> NDArray[np.bool_]:
    """Return for each step of a sequence, shape ``(..., n, 4)``, whether it is a half turn."""
    qs = components(qs, 4, "qs")
    is_half: NDArray[np.bool_] = (
        np.abs(np.sum(qs[..., 1:, :] * qs[..., :-1, :], axis=-1)) <= HALF_TURN
    )
    return is_half


def align(qs: ArrayLike) -> Floats:
    """Return a sequence with signs chosen so that each quaternion is near the one before it.

    The first quaternion keeps its sign.  Each later one is negated if its dot product with its
    aligned predecessor is negative.  :func:`nearer_sign` decides the direction of half turns,
    whatever the signs and the rounding of the quaternions.

    Args:
        qs: unit quaternions, shape ``(..., n, 4)``.

    Raises:
        ValueError: there is no sequence axis.
    """
    qs = components(qs, 4, "qs")
    if qs.ndim < 2:
        raise ValueError(f"qs must be a sequence of quaternions, got shape {qs.shape}")
    dots = np.sum(qs[..., 1:, :] * qs[..., :-1, :], axis=-1)
    if np.all(dots > HALF_TURN):
        return qs.copy()
    steps = np.where(dots < 0.0, -1.0, 1.0)
    for *others, place in np.argwhere(np.abs(dots) <= HALF_TURN).tolist():
        of = qs[tuple(others)]
        steps[(*others, place)] = nearer_sign(*between(of[place], of[place + 1]).tolist())
    signs = np.ones(qs.shape[:-1])
    signs[..., 1:] = np.cumprod(steps, axis=-1)
    return qs * signs[..., None]
