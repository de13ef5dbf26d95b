"""``python -m orientd.daemon.planners SOCKET``: what the daemon's planners are forked from."""

import sys

from orientd.daemon.planners.worker import main

main(int(sys.argv[1]))
