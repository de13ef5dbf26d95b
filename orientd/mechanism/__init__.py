"""Mechanisms: how axes pose a tool, and what their limits make of a path."""

from orientd.mechanism.foresight import Foresight, refusal
from orientd.mechanism.mechanism import Mechanical, Mechanism, Reserve

__all__ = ["Foresight", "Mechanical", "Mechanism", "Reserve", "refusal"]
