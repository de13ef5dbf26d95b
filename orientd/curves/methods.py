"""The families by name, each imported when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from orientd.curves.contract import Curve

_HOMES = {
    "slerp": ("products", "Slerp"),
    "piecewise_slerp": ("products", "PiecewiseSlerp"),
    "kks_bezier": ("products", "KksBezier"),
    "kks_hermite": ("hermite", "KksHermite"),
    "kks_quintic_hermite": ("hermite", "KksQuinticHermite"),
    "kks_hermite_spline": ("hermite", "KksHermiteSpline"),
    "kks_bspline": ("products", "KksBspline"),
    "kks_uniform": ("products", "KksUniform"),
    "c2_cumulative": ("interpolating", "C2Cumulative"),
    "kks_interpolating": ("interpolating", "KksInterpolating"),
    "squad": ("triangles", "Squad"),
    "de_casteljau": ("triangles", "DeCasteljau"),
    "shoemake_bezier": ("triangles", "ShoemakeBezier"),
    "bezier_catmull_rom": ("triangles", "BezierCatmullRom"),
    "schlag_catmull_rom": ("triangles", "SchlagCatmullRom"),
    "schlag_bspline": ("triangles", "SchlagBSpline"),
    "circular_blending": ("sphere", "CircularBlending"),
    "nielson_shieh": ("inner_points", "NielsonShieh"),
    "spherical_quadratic": ("inner_points", "SphericalQuadratic"),
    "nielson_heiland": ("sphere", "NielsonHeiland"),
    "normalized_cubic": ("sphere", "NormalizedCubic"),
    "nu_spline": ("sphere", "NuSpline"),
    "rotation_vector_spline": ("rotation_vector", "RotationVectorSpline"),
    "min_acceleration": ("optimal.min_acceleration", "MinAcceleration"),
    "minimum_effort": ("optimal.minimum_effort", "MinimumEffort"),
}
"""The module of each family in this package, and its class there."""


class Families(Mapping[str, type[Curve]]):
    """The names of all families, each with its class."""

    def __getitem__(self, name: str) -> type[Curve]:
        home, written_as = _HOMES[name]
        family: type[Curve] = getattr(import_module(f"orientd.curves.{home}"), written_as)
        return family

    def __contains__(self, name: object) -> bool:
        return name in _HOMES

    def __iter__(self) -> Iterator[str]:
        return iter(_HOMES)

    def __len__(self) -> int:
        return len(_HOMES)


METHODS: Mapping[str, type[Curve]] = Families()
"""Every family by its name, imported when it is first asked for."""
