"""Classes of other projects, with the same names and shapes, that move devices of orientd."""

from orientd.compat.interpolation_controller import RTDEInterpolationController
