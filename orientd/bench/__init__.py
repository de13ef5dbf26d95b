"""Measurements on this machine: the servo beside a bare C loop, the curves beside scipy."""

from __future__ import annotations

from orientd.bench.curves import CurveSpeed, measure_curves
from orientd.bench.retarget import PARTS, measure_retargets
from orientd.bench.servo import Comparison, compare, conditions
