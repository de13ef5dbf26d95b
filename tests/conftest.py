import sys
from pathlib import Path

# The rigs that several test modules share.
for folder in (
    "unit/servo",
    "unit/servo/tracking",
    "unit/daemon",
    "unit/curves",
    "unit/planner",
    "unit/viewer",
    "unit/recorder",
    "system",
    "chaos",
    "drivers/ur",
    "data/standard",
    "bench",
):
    sys.path.insert(0, str(Path(__file__).parent / folder))
