"""An emulated UR controller with its arm: RTDE, dashboard and script port on real sockets."""

from orientd_sim.ur.controller import Behaviour, Controller
from orientd_sim.ur.launch import EmulatedRobot, LaunchError
from orientd_sim.ur.server import serve

__all__ = ["Behaviour", "Controller", "EmulatedRobot", "LaunchError", "serve"]
