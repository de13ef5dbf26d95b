"""Where the command `orientd` begins: a stop goes out at once, and Ctrl-C is one line already."""

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
    """Run what the command line says: a stop before that is loaded, anything else by it."""
    _open_standard_streams()
    # Whoever ignores the signal, such as a shell for its background jobs, has a reason to.
    is_ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_ours:
        signal.signal(signal.SIGINT, _end)
    asked = first_stop.plain(sys.argv[1:])
    if asked is not None:
        answers = first_stop.first(asked)
        from orientd.cli import urgent

        if urgent.run(asked, answers):
            sys.exit(0)
    if not sys.warnoptions:
        # Warnings of libraries name their own files: they are for whoever asks for them.
        import warnings

        warnings.simplefilter("ignore")
    from orientd.cli.main import main as run

    if is_ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()
    sys.exit(0)


def _open_standard_streams() -> None:
    """Let what is closed of the standard streams be nothing, rather than what is opened next."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            nothing = open(os.devnull, mode)  # noqa: SIM115, PTH123 - it takes the free number
            os.set_inheritable(nothing.fileno(), True)
            setattr(sys, name, nothing)


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: nothing has begun, and an exception inside an import would be one of theirs."""
    del number, frame
    os.write(2, b"orientd: interrupted\n")
    os._exit(1)
