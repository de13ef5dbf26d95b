"""The families by name, each imported when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from orientd.curves.contract import Curve

_CLASSES = {
    "slerp": "Slerp",
    "piecewise_slerp": "PiecewiseSlerp",
    "kks_bezier": "KksBezier",
    "kks_hermite": "KksHermite",
    "kks_quintic_hermite": "KksQuinticHermite",
    "kks_hermite_spline": "KksHermiteSpline",
    "kks_bspline": "KksBspline",
    "kks_uniform": "KksUniform",
    "c2_cumulative": "C2Cumulative",
    "kks_interpolating": "KksInterpolating",
    "squad": "Squad",
    "de_casteljau": "DeCasteljau",
    "shoemake_bezier": "ShoemakeBezier",
    "bezier_catmull_rom": "BezierCatmullRom",
    "schlag_catmull_rom": "SchlagCatmullRom",
    "schlag_bspline": "SchlagBSpline",
    "circular_blending": "CircularBlending",
    "nielson_shieh": "NielsonShieh",
    "spherical_quadratic": "SphericalQuadratic",
    "nielson_heiland": "NielsonHeiland",
    "normalized_cubic": "NormalizedCubic",
    "nu_spline": "NuSpline",
    "rotation_vector_spline": "RotationVectorSpline",
    "min_acceleration": "MinAcceleration",
    "minimum_effort": "MinimumEffort",
}
"""The class of each family, in the module of the family's name."""


class Families(Mapping[str, type[Curve]]):
    """The names of all families, each with its class."""

    def __getitem__(self, name: str) -> type[Curve]:
        written_as = _CLASSES[name]
        family: type[Curve] = getattr(import_module(f"orientd.curves.{name}"), written_as)
        return family

    def __contains__(self, name: object) -> bool:
        return name in _CLASSES

    def __iter__(self) -> Iterator[str]:
        return iter(_CLASSES)

    def __len__(self) -> int:
        return len(_CLASSES)


METHODS: Mapping[str, type[Curve]] = Families()
