"""``python -m orientd.fleet LINK``: the gateway of a daemon, at the other end of LINK."""

import sys

from orientd.fleet.gateway import main

main(int(sys.argv[1]))
