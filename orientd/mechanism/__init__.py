"""Mechanisms: how axes pose a tool, and what their limits make of a path."""

from orientd.mechanism.mechanism import Mechanical, Mechanism, Reserve

__all__ = ["Mechanical", "Mechanism", "Reserve"]
