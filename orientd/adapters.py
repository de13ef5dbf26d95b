"""Where version 0.2 had what is a package of its own now."""

raise ImportError(
    "orientd.adapters is now orientd_bluesky (RotationAxis, FlyScan), orientd_rotctld, "
    "orientd_mavlink and orientd_alpaca"
)
