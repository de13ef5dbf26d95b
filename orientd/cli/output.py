"""How commands speak: plain lines or one JSON object, and one line for what goes wrong.

Standard output carries what was asked for, standard error what went wrong.  Exit status 0 is done,
1 is refused or failed, 2 is a mistake in the command line itself.
"""

from __future__ import annotations

import functools
import inspect
import json
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar

import typer

from orientd.errors import LimitError, OrientdError, RequestError

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Socket = Annotated[
    Path | None,
    typer.Option("--socket", help="Where the daemon listens.", envvar="ORIENTD_SOCKET"),
]
DeviceName = Annotated[
    str, typer.Option("--device", "-d", help="Which device, where there are several.")
]

_REMOTE = {
    "address": Annotated[
        str | None,
        typer.Option("--address", metavar="HOST:PORT", help="Reach a daemon over TCP, with TLS."),
    ],
    "cert": Annotated[Path | None, typer.Option("--cert", help="For --address: who this is.")],
    "key": Annotated[Path | None, typer.Option("--key", help="For --address: of --cert.")],
    "ca": Annotated[Path | None, typer.Option("--ca", help="For --address: of the daemon.")],
}

_QUATERNIONS = {"q", "feedback_q"}

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")


def command(run: Callable[Parameters, None]) -> Callable[Parameters, None]:
    """Make a command of *run*: what goes wrong becomes one line and exit status 1.

    Where the command has ``as_json``, it is one JSON object instead, on standard error too.  Where
    it has ``socket`` to connect to, it gets the options of a daemon that is reached over TCP.
    """

    @functools.wraps(run)
    def reporting(*arguments: Parameters.args, **options: Parameters.kwargs) -> None:
        as_json = bool(options.get("as_json"))
        for name in _REMOTE:
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
            # Whoever read has had enough; what is still buffered has nowhere to go.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(1) from None

    signature = inspect.signature(run, eval_str=True)
    if "socket" in signature.parameters:
        more = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in _REMOTE.items()
        ]
        listed = [*signature.parameters.values(), *more]
        reporting.__signature__ = signature.replace(parameters=listed)  # type: ignore[attr-defined] # typer reads it
        reporting.__annotations__ = {**run.__annotations__, **_REMOTE}
    return reporting


def fail(error: OrientdError, *, as_json: bool) -> None:
    """Say what went wrong and exit with status 1."""
    if as_json:
        print(json.dumps({"error": describe(error)}), file=sys.stderr)  # noqa: T201
    else:
        text = " ".join(str(error).split())
        print(f"orientd: {text}", file=sys.stderr)  # noqa: T201
    raise typer.Exit(1) from None


def describe(error: OrientdError) -> dict[str, Any]:
    """Return what a program wants to know of *error*."""
    described: dict[str, Any] = {"kind": type(error).__name__, "message": str(error)}
    if isinstance(error, RequestError):
        described["field"] = error.field
    if isinstance(error, LimitError):
        for name in ("quantity", "value", "limit", "time", "unit"):
            described[name] = plain(getattr(error, name))
    return described


def say(*lines: str) -> None:
    """Print lines for people, at once: a pipe shows them as they come, like a terminal."""
    if lines:
        print(*lines, sep="\n", flush=True)  # noqa: T201


def say_json(content: object) -> None:
    """Print one JSON object, at once."""
    print(json.dumps(plain(content)), flush=True)  # noqa: T201


def plain(content: object) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Return *content* as what JSON can hold; quaternions with their components by name."""
    if is_dataclass(content) and not isinstance(content, type):
        return {
            field.name: _named(field.name, getattr(content, field.name))
            for field in fields(content)
        }
    if isinstance(content, Enum):
        return content.name.lower()
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {str(key): _named(str(key), inner) for key, inner in content.items()}
    if isinstance(content, tuple) and hasattr(content, "_asdict"):
        return plain(content._asdict())
    if isinstance(content, list | tuple):
        return [plain(inner) for inner in content]
    if hasattr(content, "tolist"):
        return plain(content.tolist())
    if isinstance(content, Path):
        return str(content)
    return content


def _named(name: str, content: object) -> Any:  # noqa: ANN401 - whatever JSON can hold
    listed = plain(content)
    if name in _QUATERNIONS and isinstance(listed, list) and len(listed) == 4:
        return dict(zip("wxyz", listed, strict=True))
    return listed


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with columns side by side, never cut off.

    >>> table(["name", "rate"], [["arm", "500 Hz"]])
    ['name  rate', 'arm   500 Hz']
    """
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (header, *rows)
    ]


def is_terminal() -> bool:
    """Return whether somebody is looking at standard output."""
    return sys.stdout.isatty()
