"""Run the process that forks planners: ``python -m orientd.daemon.planners SOCKET``."""

import sys

from orientd.daemon.planners.worker import main

main(int(sys.argv[1]))
