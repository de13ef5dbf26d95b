"""The command `orientd`: its commands, each loaded when it is asked for."""

from __future__ import annotations

import os
import signal
from importlib import import_module
from typing import Annotated, Any

import typer

import orientd
from orientd.cli.output import say
from orientd.cli.usage import Commands

_MODULES = {
    "demo": "demo",
    "daemon_commands": "run status devices methods",
    "motion_commands": "plan move",
    "turn": "home turn",
    "track": "track",
    "teach": "teach",
    "batch": "batch",
    "compare": "compare",
    "plot": "plot",
    "record": "record export",
    "replay": "replay",
    "device_commands": "stop halt pause resume speed enable disable reset",
    "doctor": "doctor",
    "view": "view",
    "bench": "bench",
    "sim": "sim",
    "service": "service",
    "access_commands": "lease audit",
    "fleet": "fleet",
}
"""The commands, or groups of commands, of each module, in the order of the help."""

_HOMES = {name: module for module, names in _MODULES.items() for name in names.split()}


class LazyCommands(Commands):
    """The group of all commands, which loads the one that is asked for."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - handed on
        super().__init__(**{**settings, "commands": dict.fromkeys(_HOMES)})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ANN401 - Click's
        """Return the command of that name, or ``None``."""
        del ctx
        if cmd_name not in _HOMES:
            return None
        found = getattr(import_module(f"orientd.cli.commands.{_HOMES[cmd_name]}"), cmd_name)
        alone = typer.Typer(rich_markup_mode=None)
        if isinstance(found, typer.Typer):
            alone.add_typer(found)
        else:
            # A negative speed is a wrong speed, not an option.
            is_lax = cmd_name == "speed"
            alone.command(context_settings={"ignore_unknown_options": is_lax})(found)
        return typer.main.get_group(alone).commands[cmd_name]


app = typer.Typer(
    name="orientd",
    cls=LazyCommands,
    help="Plan smooth orientation motion and stream it to robots.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(is_asked: bool) -> None:
    if is_asked:
        say(f"orientd {orientd.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    del version


def main() -> None:
    """Run the command line."""
    # gRPC's own log lines are about its connections, for which our errors have words.
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")
    # To be told to end is to be interrupted: a motion stops on its path, nothing is left behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    app()


if __name__ == "__main__":  # as units of systemd begin that were installed before
    main()
