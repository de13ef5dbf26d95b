"""``python -m orientd.daemon.stops LISTENER LINK``: the process that takes stops."""

import sys

from orientd.daemon.stops.process import main

main(int(sys.argv[1]), int(sys.argv[2]))
