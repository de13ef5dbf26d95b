"""Where version 0.2 had what is a package of its own now."""

raise ImportError(
    "orientd.fleet is now orientd_fleet.client (connect_fleet, Fleet) and orientd_fleet.together "
    "(move_together, FleetMotion, Together)"
)
