"""Measurements on this machine: the servo against a bare C loop, the curves against SciPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.bench.curves import CurveSpeed, measure_curves
    from orientd.bench.retarget import PARTS, measure_retargets
    from orientd.bench.servo import Comparison, compare, conditions

__getattr__ = lazily(
    __name__,
    {
        "orientd.bench.curves": ("CurveSpeed", "measure_curves"),
        "orientd.bench.retarget": ("PARTS", "measure_retargets"),
        "orientd.bench.servo": ("Comparison", "compare", "conditions"),
    },
)
