"""The controller class of diffusion_policy and UMI, for devices of orientd."""

from orientd_diffusion_policy.interpolation_controller import RTDEInterpolationController
