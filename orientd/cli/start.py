"""Entry point of the command `orientd`: sends a stop at once, and handles Ctrl-C early."""

from __future__ import annotations

import _signal as signal  # type: ignore[import-not-found] # no enumerations, a stop would wait
import os
import sys

from orientd import first_stop

TYPE_CHECKING = False  # of typing, which takes as long to load as a stop takes to go out
if TYPE_CHECKING:
    from types import FrameType
    from typing import NoReturn


def main() -> NoReturn:
    """Run the command line: send a stop before it is loaded, and run anything else with it."""
    _open_standard_streams()
    # A process that ignores the signal, such as a background job of a shell, has a reason to.
    is_ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_ours:
        signal.signal(signal.SIGINT, end_at_once)
    asked = first_stop.plain(sys.argv[1:])
    if asked is not None:
        answers = first_stop.first(asked)
        from orientd.cli import urgent

        if urgent.run(asked, answers):
            sys.exit(0)
    if not sys.warnoptions:
        # Warnings of libraries name their own files: they are for developers only.
        import warnings

        warnings.simplefilter("ignore")
    from orientd.cli.main import main as run

    run(end_at_once)
    sys.exit(0)


def _open_standard_streams() -> None:
    """Replace closed standard streams by /dev/null, before an opened file takes their place."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            nothing = open(os.devnull, mode)  # noqa: SIM115, PTH123 - it takes the free number
            os.set_inheritable(nothing.fileno(), True)
            setattr(sys, name, nothing)


def end_at_once(number: int, frame: FrameType | None) -> None:
    """End at a signal before the command runs: an exception would look like a library's."""
    del frame
    os.write(2, b"orientd: interrupted\n")
    os._exit(128 + number)
