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
    "squad": ("families.squad", "Squad"),
    "de_casteljau": ("families.de_casteljau", "DeCasteljau"),
    "shoemake_bezier": ("families.shoemake_bezier", "ShoemakeBezier"),
    "bezier_catmull_rom": ("families.bezier_catmull_rom", "BezierCatmullRom"),
    "schlag_catmull_rom": ("families.schlag_catmull_rom", "SchlagCatmullRom"),
    "schlag_bspline": ("families.schlag_bspline", "SchlagBSpline"),
    "circular_blending": ("families.circular_blending", "CircularBlending"),
    "nielson_shieh": ("families.nielson_shieh", "NielsonShieh"),
    "spherical_quadratic": ("families.spherical_quadratic", "SphericalQuadratic"),
    "nielson_heiland": ("families.nielson_heiland", "NielsonHeiland"),
    "normalized_cubic": ("families.normalized_cubic", "NormalizedCubic"),
    "nu_spline": ("families.nu_spline", "NuSpline"),
    "rotation_vector_spline": ("families.rotation_vector_spline", "RotationVectorSpline"),
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
