"""Every family of curves on the rotation group, behind one contract.

``METHODS`` maps the name of a family to its class, which takes the family's parameters as
keyword arguments; what it makes is a :class:`Curve`.  Importing this imports neither SciPy nor
any family: each is imported when it is first asked for.
"""

from orientd.curves.contract import Curve, Samples
from orientd.curves.methods import METHODS

__all__ = ["METHODS", "Curve", "Samples"]
