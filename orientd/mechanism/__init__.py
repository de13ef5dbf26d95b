"""Mechanisms: how axes pose a tool, and what their limits make of a path."""

from orientd.mechanism.mechanism import Mechanism

__all__ = ["Mechanism"]
