"""What a command is made of: its options, and one line for what goes wrong.

Exit status 0 is done, 1 is refused or failed, 2 is a mistake in the command line itself.
"""

from __future__ import annotations

import functools
import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ParamSpec

import typer

from orientd.cli.completion import SETTINGS, devices, files
from orientd.cli.output import close_output, complain, plain
from orientd.errors import LimitError, OrientdError, RequestError
from orientd.one_line import one_line

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Socket = Annotated[
    Path | None,
    typer.Option("--socket", help="Where the daemon listens.", envvar="ORIENTD_SOCKET"),
]
Partial = Annotated[
    bool, typer.Option("--partial", help="Use what can be read of a cut or damaged recording.")
]
Topic = Annotated[
    str, typer.Option("--topic", "-t", help="Which orientation, where there are several.")
]
DeviceName = Annotated[
    str,
    typer.Option(
        "--device", "-d", help="Which device, where there are several.", autocompletion=devices
    ),
]


def config_option(text: str) -> Any:  # noqa: ANN401 - as Typer says of its own
    """Return the option that names a configuration, with *text* for its help."""
    return typer.Option("--config", "-c", help=text, autocompletion=files(*SETTINGS))


ConfigFile = Annotated[
    Path | None,
    config_option(
        "The configuration; default: $ORIENTD_CONFIG, ~/.config/orientd/orientd.toml, or "
        "one loopback device."
    ),
]

Beside = Annotated[
    bool,
    typer.Option("--lease", help="Command beside your command in another terminal."),
]

_REMOTE = {
    "address": Annotated[
        str | None,
        typer.Option(
            "--address",
            metavar="HOST:PORT",
            help="Reach a daemon over TCP, with TLS; or fleet:NAME of the cell $ORIENTD_CELL.",
        ),
    ],
    "cert": Annotated[Path | None, typer.Option("--cert", help="For --address: who this is.")],
    "key": Annotated[Path | None, typer.Option("--key", help="For --address: of --cert.")],
    "ca": Annotated[Path | None, typer.Option("--ca", help="For --address: of the daemon.")],
}

LONG = 1.0
"""What a refused motion took beyond this, s, is told."""

Parameters = ParamSpec("Parameters")


def command(run: Callable[Parameters, None]) -> Callable[Parameters, None]:
    """Make a command of *run*: what goes wrong becomes one line and exit status 1.

    Where the command has ``as_json``, it is one JSON object instead, on standard error too.  Where
    it has ``socket`` to connect to, it gets the options of a daemon that is reached over TCP.
    """
    signature = inspect.signature(run, eval_str=True)
    remote = _REMOTE if "socket" in signature.parameters else {}

    @functools.wraps(run)
    def reporting(*arguments: Parameters.args, **options: Parameters.kwargs) -> None:
        as_json = bool(options.get("as_json"))
        for name in remote:
            given = options.pop(name, None)
            if given is not None:
                os.environ[f"ORIENTD_{name.upper()}"] = str(given)
                if name == "address":
                    options["socket"] = None
        try:
            run(*arguments, **options)
            sys.stdout.flush()
        except OrientdError as error:
            fail(error, as_json=as_json)
        except KeyboardInterrupt:
            fail(OrientdError("interrupted"), as_json=as_json)
        except BrokenPipeError:
            close_output()
            raise typer.Exit(1) from None
        except OSError as error:  # of a name that no file can have, where nobody else has looked
            what = f"{one_line(str(error.filename), 100)}: " if error.filename else ""
            fail(OrientdError(f"{what}{error.strerror or error}"), as_json=as_json)

    if remote:
        more = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in remote.items()
        ]
        listed = [*signature.parameters.values(), *more]
        reporting.__signature__ = signature.replace(parameters=listed)  # type: ignore[attr-defined] # typer reads it
        reporting.__annotations__ = {**run.__annotations__, **remote}
    return reporting


def fail(error: OrientdError, *, as_json: bool) -> None:
    """Say what went wrong and exit with status 1."""
    complain(describe(error), as_json=as_json, more=_took(error))
    raise typer.Exit(1) from None


def _took(error: OrientdError) -> str:
    """Return how long it took until a motion was refused, where that was long."""
    if error.planning < LONG:
        return ""
    waiting = f"{error.waiting:.1f} s of it waiting for the device"
    return f" (refused after {error.planning:.1f} s, {waiting})"


def describe(error: OrientdError) -> dict[str, Any]:
    """Return what a program wants to know of *error*."""
    described: dict[str, Any] = {"kind": type(error).__name__, "message": str(error)}
    if isinstance(error, RequestError):
        described["field"] = error.field
    if error.planning:
        described |= {"planning": error.planning, "waiting": error.waiting}
    if isinstance(error, LimitError):
        for name in ("quantity", "value", "limit", "time", "unit"):
            described[name] = plain(getattr(error, name))
    return described
