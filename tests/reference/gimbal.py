"""What is usually made of the Jacobian of a gimbal: rates of the tool, and damped rates of axes."""

import numpy as np

from orientd.rotation import from_axis_angle, multiply, to_matrix


def jacobian(gimbal, angles):
    """Return the matrix from axis rates to the angular velocity in the world, ``(..., 3, axes)``.

    Its columns are the directions of the axes.
    """
    angles = np.asarray(angles, dtype=np.float64)
    q = np.broadcast_to(np.array(gimbal.kinematics.mount), (*angles.shape[:-1], 4))
    columns = []
    for number, axis in enumerate(gimbal.kinematics.axes):
        columns.append(to_matrix(q)[..., :, axis])
        q = multiply(q, from_axis_angle(np.eye(3)[axis], angles[..., number]))
    return np.stack(columns, axis=-1)


def damped_rates(jacobian, omega, *, epsilon=0.12, damping=0.12):
    r"""Return axis rates by damped least squares, the usual way past a singularity.

    .. math:: \dot q = J^T (J J^T + \lambda^2 I)^{-1} \omega,\quad
        \lambda^2 = \lambda_{max}^2 (1 - (\sigma / \epsilon)^2) \text{ for } \sigma < \epsilon

    Source: Nakamura and Hanafusa (1986); the variable damping is Chiaverini's (1994).  It looks one
    step ahead only: :mod:`orientd.mechanism.routing` plans the whole path instead.

    Args:
        jacobian: shape ``(..., 3, axes)``.
        omega: angular velocity wanted, rad/s, shape ``(..., 3)``.
        epsilon: least singular value below which damping begins.
        damping: its largest value.
    """
    u, sigma, vt = np.linalg.svd(jacobian, full_matrices=False)
    share = np.minimum(1.0, sigma[..., -1] / epsilon)
    square = damping**2 * (1.0 - share**2)
    gains = sigma / (sigma**2 + square[..., None] + 1e-300)
    wanted = np.einsum("...ji,...j->...i", u, np.asarray(omega, dtype=np.float64))
    return np.einsum("...ij,...i->...j", vt, gains * wanted)
