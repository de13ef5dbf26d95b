"""Where version 0.2 had what is a package of its own now."""

raise ImportError("orientd.fleet is now orientd_fleet: connect_fleet, move_together and others")
