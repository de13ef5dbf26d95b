"""Every family of curves on the rotation group, behind one contract.

``METHODS`` maps the name of a family to its class, which takes the family's parameters as
keyword arguments; what it makes is a :class:`Curve`.  Importing this imports neither SciPy nor
Numba.
"""

from collections.abc import Mapping
from types import MappingProxyType

from orientd.curves.contract import Curve, Samples
from orientd.curves.piecewise_slerp import PiecewiseSlerp

METHODS: Mapping[str, type[Curve]] = MappingProxyType(
    {family.name: family for family in (PiecewiseSlerp,)}
)

__all__ = ["METHODS", "Curve", "Samples"]
