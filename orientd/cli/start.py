"""Where the command `orientd` begins: while modules are still loaded, Ctrl-C is one line too."""

from __future__ import annotations

import os
import signal
from types import FrameType


def main() -> None:
    """Load the command line and run it."""
    # Whoever ignores the signal, such as a shell for its background jobs, has a reason to.
    is_ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_ours:
        signal.signal(signal.SIGINT, _end)
    from orientd.cli.main import main as run

    if is_ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: nothing has begun, and an exception inside an import would be one of theirs."""
    del number, frame
    os.write(2, b"orientd: interrupted\n")
    os._exit(1)
