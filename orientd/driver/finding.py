"""What a look at a machine or at a device has found, and what it means."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """What a finding means for real time, or for moving a device at all."""

    OK = "ok"
    IMPROVE = "improve"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One look.

    Attributes:
        name: what was looked at.
        found: what was found.
        verdict: what that means.
        mend: what to do about it; empty where it is well.
    """

    name: str
    found: str
    verdict: Verdict
    mend: str = ""
