"""What constructions of curves share: bases, increments, ends."""

from orientd.curves.construct.acceleration_integral import Path, squared_acceleration
from orientd.curves.construct.banded import solve_banded, solve_blocks
from orientd.curves.construct.basis import CumulativeBasis, Indices, cumulative_basis
from orientd.curves.construct.knots import inner_multiplicity, resolve_knots
from orientd.curves.construct.spline_ends import outer_derivatives
from orientd.curves.construct.velocities import RULES, half_velocities
