"""An emulated UR controller with its arm: RTDE, dashboard and script port on real sockets."""

from __future__ import annotations

from emulated_ur.arm import MODELS, Behaviour, version_of
from emulated_ur.controller import Controller
from emulated_ur.process import EmulatedRobot, LaunchError
from emulated_ur.server import serve
