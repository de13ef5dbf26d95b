"""Every family of curves on the rotation group, behind one contract.

``METHODS`` maps the name of a family to its class, which takes the family's parameters as
keyword arguments; what it makes is a :class:`Curve`.  Importing this imports neither SciPy nor
Numba.
"""

from collections.abc import Mapping
from types import MappingProxyType

from orientd.curves.bezier_catmull_rom import BezierCatmullRom
from orientd.curves.c2_cumulative import C2Cumulative
from orientd.curves.circular_blending import CircularBlending
from orientd.curves.contract import Curve, Samples
from orientd.curves.de_casteljau import DeCasteljau
from orientd.curves.kks_bezier import KksBezier
from orientd.curves.kks_bspline import KksBspline
from orientd.curves.kks_hermite import KksHermite
from orientd.curves.kks_hermite_spline import KksHermiteSpline
from orientd.curves.kks_interpolating import KksInterpolating
from orientd.curves.kks_quintic_hermite import KksQuinticHermite
from orientd.curves.kks_uniform import KksUniform
from orientd.curves.min_acceleration import MinAcceleration
from orientd.curves.minimum_effort import MinimumEffort
from orientd.curves.nielson_heiland import NielsonHeiland
from orientd.curves.nielson_shieh import NielsonShieh
from orientd.curves.normalized_cubic import NormalizedCubic
from orientd.curves.nu_spline import NuSpline
from orientd.curves.piecewise_slerp import PiecewiseSlerp
from orientd.curves.rotation_vector_spline import RotationVectorSpline
from orientd.curves.schlag_bspline import SchlagBSpline
from orientd.curves.schlag_catmull_rom import SchlagCatmullRom
from orientd.curves.shoemake_bezier import ShoemakeBezier
from orientd.curves.slerp import Slerp
from orientd.curves.spherical_quadratic import SphericalQuadratic
from orientd.curves.squad import Squad

_FAMILIES: tuple[type[Curve], ...] = (
    Slerp,
    PiecewiseSlerp,
    KksBezier,
    KksHermite,
    KksQuinticHermite,
    KksHermiteSpline,
    KksBspline,
    KksUniform,
    C2Cumulative,
    KksInterpolating,
    Squad,
    DeCasteljau,
    ShoemakeBezier,
    BezierCatmullRom,
    SchlagCatmullRom,
    SchlagBSpline,
    CircularBlending,
    NielsonShieh,
    SphericalQuadratic,
    NielsonHeiland,
    NormalizedCubic,
    NuSpline,
    RotationVectorSpline,
    MinAcceleration,
    MinimumEffort,
)

METHODS: Mapping[str, type[Curve]] = MappingProxyType({family.name: family for family in _FAMILIES})

__all__ = ["METHODS", "Curve", "Samples"]
