"""Entry of the servo process; only the daemon starts it."""

import json
import sys

from orientd.servo.process import ProcessSettings, run

if __name__ == "__main__":
    sys.exit(run(int(sys.argv[1]), ProcessSettings(**json.load(sys.stdin))))
