"""Where LeRobot is not installed, its stand-in in the tests of orientd takes its place."""

import importlib.util
import os
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
STAND_IN = PACKAGE.parents[1] / "tests" / "lerobot_stand_in"

if importlib.util.find_spec("lerobot") is None:
    folders = [str(STAND_IN), str(PACKAGE)]
    sys.path[:0] = folders
    programs = [*folders, *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ["PYTHONPATH"] = os.pathsep.join(programs)
