"""All families of curves on the rotation group, with one contract.

``METHODS`` maps the name of a family to its class.  The class takes the family's parameters as
keyword arguments and makes a :class:`Curve`.  Importing this package imports neither SciPy nor any
family: each family is imported on first use.

Other packages import from ``axis_turn``, ``basis``, ``comparison``, ``contract``, ``fitting``,
``hermite``, ``interpolating``, ``keyframes``, ``products``, ``quintic``, ``roles`` and
``trajectory``.
"""

from orientd.curves.basis import CumulativeBasis, Indices, cumulative_basis
from orientd.curves.contract import METHODS, Curve
from orientd.curves.keyframes import (
    ParameterError,
    check_keys,
    is_same,
    resolve_knots,
    resolve_times,
)
from orientd.curves.roles import (
    CurveTask,
    UnevenError,
    is_pair,
    make_curve,
    options_of,
    parameters,
    turns_name,
)
from orientd.curves.trajectory import PIECE, Samples, TimeMap, Trajectory

__all__ = [
    "METHODS",
    "PIECE",
    "CumulativeBasis",
    "Curve",
    "CurveTask",
    "Indices",
    "ParameterError",
    "Samples",
    "TimeMap",
    "Trajectory",
    "UnevenError",
    "check_keys",
    "cumulative_basis",
    "is_pair",
    "is_same",
    "make_curve",
    "options_of",
    "parameters",
    "resolve_knots",
    "resolve_times",
    "turns_name",
]
