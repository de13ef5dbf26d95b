"""``python -m orientd.daemon.planners SOCKET MEMORY``: a planner process of the daemon."""

import sys

from orientd.daemon.planners.worker import main

main(int(sys.argv[1]), int(sys.argv[2]))
