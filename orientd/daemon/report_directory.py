"""Where the daemon and its processes write down what happened."""

from __future__ import annotations

import os
from pathlib import Path


def report_directory() -> str:
    """Return the folder for reports, which is made if it is not there (the XDG state directory)."""
    home = os.environ.get("XDG_STATE_HOME") or Path("~/.local/state").expanduser()
    directory = Path(home) / "orientd"
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    return str(directory)
