"""Entry point of the servo process; only the daemon starts it."""

import os
import sys

from orientd.servo.process import run
from orientd.servo.settings import ProcessSettings

if __name__ == "__main__":
    status = run(int(sys.argv[1]), ProcessSettings.from_json(sys.stdin.read()))
    sys.stderr.flush()
    # Skip the interpreter's cleanup: a vendor's destructor may hang or abort the process.
    os._exit(status)
