"""The families of curves that the papers describe, a module for each."""

from orientd.curves.families.c2_cumulative import C2Cumulative
from orientd.curves.families.kks.bspline import KksBspline
