"""`orientd audit`: whether the log of who commanded what is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orientd.cli.command import AsJson, command
from orientd.cli.commands.daemon_commands import ConfigFile
from orientd.cli.output import say, say_json
from orientd.errors import OrientdError

audit = typer.Typer(name="audit", help="Look after the audit log.", no_args_is_help=True)


@audit.callback()
def _group() -> None:
    pass


@audit.command()
@command
def verify(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="The log; default: that of the configuration."),
    ] = None,
    config: ConfigFile = None,
    as_json: AsJson = False,
) -> None:
    """Follow the chain of the audit log, those put aside included, and name every gap.

    The end of a log that was cut off shows in its last digest alone, which the daemon logs when it
    begins and ends.
    """
    from orientd import config as configuration
    from orientd.daemon import audit_path, verify_audit

    if file is None:
        path = config or configuration.find()
        settings = configuration.load(path) if path else configuration.default_settings()
        file = audit_path(settings.access)
    found = verify_audit(file)
    if as_json:
        say_json({"is_whole": not found.problems, **vars(found)})
    else:
        before = f", those before line {found.first} forgotten" if found.first > 1 else ""
        say(f"{found.lines} lines in {len(found.files)} files{before}")
        say(f"the last is line {found.last}, {found.digest}", *found.problems)
    if found.problems:
        raise OrientdError(f"{file}: the chain is broken in {len(found.problems)} places")
