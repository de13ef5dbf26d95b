"""``python -m orientd_sim.dynamixel --link PATH``."""

import sys

from orientd_sim.dynamixel.command import main

sys.exit(main())
