"""Orientation and position together, offline: a certified motion, and where it is over time."""

from scipy.spatial.transform import Rotation

import orientd

motion = orientd.plan(
    Rotation.from_euler("ZYX", [[0, 0, 0], [45, 20, 0], [90, 0, 10]], degrees=True),
    positions=[[0.4, -0.2, 0.3], [0.5, 0.0, 0.4], [0.4, 0.2, 0.3]],  # m
    limits={"velocity": 1.5, "linear_velocity": 0.5},  # rad/s, m/s
)
turn, shift = motion.certificate.peak_velocity, motion.certificate.peak_linear_velocity
print(f"turns with at most {turn.value:.2f} of {turn.limit} rad/s")
print(f"moves with at most {shift.value:.2f} of {shift.limit} m/s")
samples = motion.sample([0.0, motion.duration])
print("from", samples.position[0].round(6).tolist(), "to", samples.position[-1].round(6).tolist())
orientd.plots.draw(motion, "pose.svg", title="Three poses")
