"""A curve through five rotations, and a certified motion: no daemon, no gRPC."""

import pickle

from scipy.spatial.transform import Rotation

import orientd

keys = Rotation.from_rotvec([[0, 0, 0], [0, 0.2, 0.5], [0.3, 0, 1], [0, -0.2, 1.5], [0, 0, 2]])
asked = {"times": [0, 1, 2, 3, 4], "start_velocity": [0, 0, 0.5], "end_velocity": [0.2, 0, 0.4]}
curve = orientd.curves.METHODS["c2_cumulative"](keys=keys, **asked)  # curve(t) is a Rotation
q, omega_body, alpha_body = pickle.loads(pickle.dumps(curve)).evaluate([0.0, 1.5, 4.0])  # rad/s
motion = orientd.plan(keys, **asked, approach=True)  # with lead-in, lead-out and certificate
motion.save("turn.npz")
orientd.plots.draw(orientd.load_motion("turn.npz"), "turn.svg")  # this one line needs Matplotlib
