"""Findings: what an inspection of a machine or a device found, and what it means."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """The meaning of a finding for real-time operation, or for moving a device at all."""

    OK = "ok"
    IMPROVE = "improve"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding.

    Attributes:
        name: what was inspected.
        found: its value or state.
        verdict: what that means.
        mend: how to improve it; empty if nothing needs to change.
    """

    name: str
    found: str
    verdict: Verdict
    mend: str = ""
