"""Where version 0.2 had what is a package of its own now."""

raise ImportError("orientd.compat is now orientd_diffusion_policy")
