"""All families of curves on the rotation group, with one contract.

``METHODS`` maps the name of a family to its class.  The class takes the family's parameters as
keyword arguments and makes a :class:`Curve`.  Importing this package imports neither SciPy nor any
family: each family is imported on first use.

Other packages import from ``axis_turn``, ``basis``, ``comparison``, ``contract``, ``fitting``,
``hermite``, ``interpolating``, ``keyframes``, ``products``, ``quintic``, ``roles`` and
``trajectory``.
"""

from orientd.lazy import lazily

TYPE_CHECKING = False  # of typing, without loading it
if TYPE_CHECKING:
    from orientd.curves.axis_turn import AxisTurn
    from orientd.curves.basis import CumulativeBasis, Indices, cumulative_basis
    from orientd.curves.comparison import MET, Candidate, Figures, compare, measure, ranked
    from orientd.curves.contract import METHODS, Curve
    from orientd.curves.fitting import Fit, describe_bursts, fit_orientations
    from orientd.curves.hermite import KksHermite
    from orientd.curves.interpolating import C2Cumulative, KksInterpolating
    from orientd.curves.keyframes import (
        ParameterError,
        check_keys,
        is_same,
        resolve_knots,
        resolve_times,
    )
    from orientd.curves.products import KksBspline
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

__getattr__ = lazily(__name__)
