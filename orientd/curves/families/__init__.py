"""The families of curves that the papers describe, a module for each."""

from orientd.curves.families.rotation_vector_spline import RotationVectorSpline
