"""An emulated UR controller with its arm: RTDE, dashboard and script port on real sockets."""

from __future__ import annotations

from orientd_sim.ur.arm import MODELS, Behaviour, version_of
from orientd_sim.ur.controller import Controller
from orientd_sim.ur.server import serve
