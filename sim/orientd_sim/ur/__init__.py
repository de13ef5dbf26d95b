"""An emulated UR controller with its arm: RTDE, dashboard and script port on real sockets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_sim.ur.arm import MODELS, Behaviour, version_of
    from orientd_sim.ur.controller import Controller
    from orientd_sim.ur.server import serve

__getattr__ = lazily(__name__)
