"""The command `orientd`: its commands, and one line for each error.

Exit status 0 means done, 1 refused or failed, 2 a usage error, and 128 plus its number a signal
that ended the command: 130 for Ctrl-C.  A motion that a signal stops has failed.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import click

import orientd
from orientd.cli.installed import OpenGroup
from orientd.cli.interrupts import ignore, interrupt_at
from orientd.cli.output import Output, complain, plain
from orientd.cli.parameters import Command, Option, command_of
from orientd.errors import LimitError, OrientdError, RequestError
from orientd.one_line import one_line

_MODULES = {
    "demo": "demo",
    "daemon_commands": "run status devices methods",
    "motion_commands": "plan move home turn",
    "track": "track",
    "teach": "teach",
    "compare": "compare",
    "plot": "plot",
    "record": "record export",
    "device_commands": "stop halt pause resume speed enable disable reset",
    "doctor": "doctor",
    "view": "view",
    "bench": "bench",
    "sim": "sim",
    "service": "service",
    "access_commands": "lease audit",
}
"""The commands, or groups of commands, of each module, in the order of the help."""

_HOMES = {name: module for module, names in _MODULES.items() for name in names.split()}

_LONG = 1.0
"""Duration from which a refusal reports its time, s."""

_HELP: Any = getattr(click.exceptions, "NoArgsIsHelpError", ())
"""Click raises this for a group without a command; its text is the help.  Click 8.1 prints it."""

_NO_DEFECTS = OrientdError, OSError, MemoryError, UnicodeEncodeError, click.ClickException
"""Errors that are no defects of this program."""

TRACEBACK = "ORIENTD_TRACEBACK"
"""Environment variable that shows the traceback of a defect."""


class SignalError(OrientdError):
    """A signal has ended the command.

    Attributes:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__("interrupted")
        self.number = number


class Commands(OpenGroup):
    """The group of all commands.

    It loads only the requested command, since all of them take 140 ms longer.  An error is one line
    on standard error, or one JSON object with ``--json``.
    """

    prefix = ""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands, in the order of the help."""
        return [*_HOMES, *(name for name in super().list_commands(ctx) if name not in _HOMES)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of that name, or ``None``."""
        if cmd_name not in _HOMES:
            return super().get_command(ctx, cmd_name)
        found = getattr(import_module(f"orientd.cli.commands.{_HOMES[cmd_name]}"), cmd_name)
        if isinstance(found, click.Command):
            return found
        # A negative speed is a wrong speed, not an option.
        is_lax = cmd_name == "speed"
        return command_of(
            Command, found, name=cmd_name, context_settings={"ignore_unknown_options": is_lax}
        )

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 - what Click returns
        """Run the command of the command line; Ctrl-C is an error like others.

        Only the command can be interrupted: a further signal does not keep it from its exit status.
        """
        numbers = (signal.SIGINT, signal.SIGTERM)
        ours = [number for number in numbers if signal.getsignal(number) is ctx.obj]
        try:
            try:
                if ours:
                    interrupt_at(ours)
                return super().invoke(ctx)
            finally:
                ignore(ours)
        except KeyboardInterrupt as error:
            ignore(ours)
            raise SignalError(error.args[0] if error.args else signal.SIGINT) from error

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
        try:
            status = super().main(given, prog_name, standalone_mode=False, **extra) or 0
        except Exception as error:
            if TRACEBACK in os.environ and _is_ours(error):
                raise
            status = 2 if isinstance(error, click.ClickException) else 1
            if isinstance(error, SignalError):
                status = 128 + error.number
            _tell(error, as_json="--json" in given)
        sys.exit(status)


def _is_ours(error: Exception) -> bool:
    """Return whether *error* is a defect of this program."""
    return not isinstance(error, _NO_DEFECTS)


def _tell(error: Exception, *, as_json: bool) -> None:
    """Print an error; for people, with the duration of a refusal if it was long."""
    described = _described(error)
    more = ""
    if isinstance(error, OrientdError) and error.planning >= _LONG:
        waiting = f"{error.waiting:.1f} s of it waiting for the device"
        more = f" (refused after {error.planning:.1f} s, {waiting})"
    if isinstance(error, _HELP):
        print(error.format_message(), file=sys.stderr)  # noqa: T201
    else:
        complain(described, as_json=as_json, more=more)


def _described(error: Any) -> dict[str, Any]:  # noqa: ANN401 - Click's class is not known here
    """Return the JSON form of *error*."""
    if isinstance(error, OrientdError):
        described: dict[str, Any] = {"kind": type(error).__name__, "message": str(error)}
        if isinstance(error, RequestError):
            described["field"] = error.field
        if error.planning:
            described |= {"planning": error.planning, "waiting": error.waiting}
        if isinstance(error, LimitError):
            for name in ("quantity", "value", "limit", "time", "unit"):
                described[name] = plain(getattr(error, name))
        return described
    if isinstance(error, click.ClickException):
        return {"kind": "UsageError", "message": _usage(error)}
    if isinstance(error, OSError):  # of an invalid file name, if it was not checked before
        what = f"{one_line(str(error.filename), 100)}: " if error.filename else ""
        return {"kind": "OrientdError", "message": f"{what}{error.strerror or error}"}
    if isinstance(error, UnicodeEncodeError):  # of an argument in another encoding
        message = f"expected text in UTF-8, got {one_line(ascii(error.object), 100)}"
        return {"kind": "RequestError", "message": message}
    if isinstance(error, MemoryError):
        return {"kind": "InternalError", "message": "there is not enough memory for this"}
    last = traceback.extract_tb(error.__traceback__)[-1]
    message = (
        f"a mistake of orientd's own, {type(error).__name__} at {Path(last.filename).name}:"
        f"{last.lineno}: {str(error)[:300]}; {TRACEBACK}=1 shows more"
    )
    return {"kind": "InternalError", "message": message}


def _usage(error: Any) -> str:  # noqa: ANN401 - a ClickException
    """Return Click's usage error in the style of the others."""
    message: str = error.format_message()
    message = message[:1].lower() + message[1:].removesuffix(".")
    message = message.replace(". Did you mean", "; did you mean")
    message = message.replace("Value error, ", "").replace("Input should be ", "expected ")
    context = getattr(error, "ctx", None)
    if isinstance(error, click.UsageError) and context is not None:
        message = f"{message}; see `{context.command_path} --help`"
    return message


def _options(
    version: Annotated[bool, Option("--version", help="Print the version.")] = False,
    install_completion: Annotated[bool, Option("--install-completion", hidden=True)] = False,
    show_completion: Annotated[bool, Option("--show-completion", hidden=True)] = False,
) -> None:
    """Plan smooth orientation motion and stream it to robots."""
    if version:
        Output().say(f"orientd {orientd.__version__}")
    elif install_completion or show_completion:
        raise OrientdError(
            "the shell itself installs completion, for example with the line "
            '`eval "$(_ORIENTD_COMPLETE=bash_source orientd)"` in ~/.bashrc'
        )
    elif click.get_current_context().invoked_subcommand is None:
        raise click.UsageError("missing command", click.get_current_context())
    else:
        return
    raise click.exceptions.Exit


app = command_of(
    Commands, _options, name="orientd", invoke_without_command=True, no_args_is_help=True
)


def main(end_at_once: Callable[..., object] = signal.default_int_handler) -> None:
    """Run the command line.

    Args:
        end_at_once: handles signals before the command runs.
    """
    # gRPC's own log lines are about its connections, which our errors describe.
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")
    # Searching for plugins of pydantic opens every installed distribution.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # SIGTERM acts like an interrupt: a motion stops on its path, and nothing is left behind.
    signal.signal(signal.SIGTERM, end_at_once)
    app(obj=end_at_once)


if __name__ == "__main__":  # as units of systemd begin that were installed before
    main()
