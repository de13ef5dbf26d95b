"""What a mistake in the command line is told in: one line, like everything else that goes wrong."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from orientd.cli.output import complain

# Typer brings its own copy of Click, or depends on Click, by its version; these are its classes.
_USAGE_ERROR, _CLICK_ERROR = typer.BadParameter.__mro__[1:3]

INTERRUPTED = 130
"""What Typer makes of Ctrl-C before a command of ours has begun."""


TRACEBACK = "ORIENTD_TRACEBACK"
"""Variable of the environment with which a mistake of ours shows where it was made."""


class Commands(TyperGroup):
    """A group whose mistakes are one line on standard error, or one JSON object with ``--json``."""

    def main(  # type: ignore[override] # of all that Click passes only this matters here
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        *,
        standalone_mode: bool = True,
        **extra: Any,  # noqa: ANN401 - handed on
    ) -> Any:  # noqa: ANN401 - what Click returns
        """Run the command line, and exit unless *standalone_mode* is off."""
        given = list(sys.argv[1:] if args is None else args)
        if not standalone_mode:
            return super().main(given, prog_name, standalone_mode=False, **extra)
        as_json = "--json" in given
        try:
            status = super().main(given, prog_name, standalone_mode=False, **extra)
        except (typer.Abort, KeyboardInterrupt):
            status = INTERRUPTED
        except Exception as error:
            if isinstance(error, _CLICK_ERROR):
                _tell(error, as_json=as_json)
                sys.exit(2)
            if TRACEBACK in os.environ:
                raise
            complain({"kind": "InternalError", "message": _mistake(error)}, as_json=as_json)
            sys.exit(1)
        if status == INTERRUPTED:
            complain({"kind": "OrientdError", "message": "interrupted"}, as_json=as_json)
            sys.exit(1)
        sys.exit(status if isinstance(status, int) else 0)


def _tell(error: Any, *, as_json: bool) -> None:  # noqa: ANN401 - a ClickException
    message = error.format_message()
    # A group without a command: the message is its help.
    if "\n" in message:
        print(message, file=sys.stderr)  # noqa: T201
        return
    message = message[:1].lower() + message[1:].removesuffix(".").replace("Value error, ", "")
    context = getattr(error, "ctx", None)
    if isinstance(error, _USAGE_ERROR) and context is not None:
        message = f"{message}; see `{context.command_path} --help`"
    complain({"kind": "UsageError", "message": message}, as_json=as_json)


def _mistake(error: Exception) -> str:
    """Return what is said of an error that nobody has foreseen."""
    if isinstance(error, MemoryError):
        return "there is not enough memory for this"
    last = traceback.extract_tb(error.__traceback__)[-1]
    return (
        f"a mistake of orientd's own, {type(error).__name__} at {Path(last.filename).name}:"
        f"{last.lineno}: {str(error)[:300]}; {TRACEBACK}=1 shows more"
    )


def check_ending(path: Path, endings: Sequence[str], *, named: str) -> None:
    """Check how the name of a file to be written ends.

    Raises:
        typer.BadParameter: it does not end in one of *endings*; *named* is the parameter.
    """
    if path.suffix not in endings:
        raise typer.BadParameter(
            f"expected a name that ends in {', '.join(endings)}, got {path.name!r}",
            param_hint=named,
        )
