"""The Jacobian of a gimbal, from the directions of its axes."""

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
