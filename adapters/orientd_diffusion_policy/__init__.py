"""Move devices of orientd with classes of other projects, under the same names and shapes."""

from orientd_diffusion_policy.interpolation_controller import RTDEInterpolationController
