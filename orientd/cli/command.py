"""The options that several commands share, and a command's connection to the daemon."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orientd.cli.output import Output
from orientd.errors import OrientdError, RequestError

if TYPE_CHECKING:
    from orientd.config import DeviceSettings
    from orientd.rpc import Robot

PATIENCE = 0.5
"""Seconds that the daemon has to name its devices to a shell that completes a word."""


def devices(context: typer.Context, incomplete: str) -> list[str]:
    """Return the devices of the daemon, or of the configuration where no daemon answers.

    A shell that waits for a word is no place for errors: if something fails, there are none.
    """
    from orientd import config
    from orientd.rpc import connect

    given = context.params.get("config")
    names: list[str] = []
    try:
        try:
            if given is None:
                with connect(context.params.get("socket"), timeout=PATIENCE) as robot:
                    names = [device.name for device in robot.devices()]
        except OrientdError:
            pass
        names = names or list(config.load_or_default(given).devices)
    except OrientdError:
        pass
    return [name for name in names if name.startswith(incomplete)]


AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Socket = Annotated[
    Path | None,
    typer.Option("--socket", help="Socket of the daemon.", envvar="ORIENTD_SOCKET"),
]
Partial = Annotated[
    bool, typer.Option("--partial", help="Read as much as possible of a cut or damaged recording.")
]
Topic = Annotated[
    str, typer.Option("--topic", "-t", help="Topic of the orientation, if there are several.")
]
DeviceName = Annotated[
    str,
    typer.Option("--device", "-d", help="Device, if there are several.", autocompletion=devices),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config",
        "-c",
        help="The configuration; default: $ORIENTD_CONFIG, ~/.config/orientd/orientd.toml, or "
        "one loopback device.",
    ),
]
Beside = Annotated[
    bool,
    typer.Option("--lease", help="Share the lease that your command in another terminal holds."),
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
    "cert": Annotated[
        Path | None, typer.Option("--cert", help="Your certificate (with --address).")
    ],
    "key": Annotated[
        Path | None, typer.Option("--key", help="The key of your certificate (with --address).")
    ],
    "ca": Annotated[
        Path | None,
        typer.Option("--ca", help="The authority that signs the daemon (with --address)."),
    ],
}


def with_options(run: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the options that it has for what its function takes.

    A function that takes ``out``, an :class:`.Output`, has ``--json``.  One that takes ``socket``
    has the options of a daemon that is reached over TCP.
    """
    taken = inspect.signature(run, eval_str=True).parameters
    is_done = hasattr(run, "__wrapped__")
    remote = _REMOTE if "socket" in taken and not is_done else {}
    added = {"as_json": AsJson, **remote} if "out" in taken else remote

    @functools.wraps(run)
    def with_all(**given: Any) -> None:  # noqa: ANN401 - those of the command
        if "out" in taken:
            given["out"] = Output(as_json=bool(given.pop("as_json")))
        for name in remote:
            value = given.pop(name)
            if name == "address" and value is not None:
                given["socket"] = None
                if ":" not in value:
                    problem = f"expected HOST:PORT or fleet:NAME, got {value!r}"
                    raise typer.BadParameter(problem, param_hint="--address")
            if value is not None:
                os.environ[f"ORIENTD_{name.upper()}"] = str(value)
        run(**given)

    listed = [
        *(one for one in taken.values() if one.name != "out"),
        *(
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in added.items()
        ),
    ]
    with_all.__signature__ = inspect.Signature(listed)  # type: ignore[attr-defined] # typer reads it
    with_all.__annotations__ = {one.name: one.annotation for one in listed}
    return with_all if added else run


def connect_as(socket: Path | None, command: str, *, beside: bool = False) -> Robot:
    """Return a connection to the daemon, which its first call opens.

    Args:
        socket: of the daemon.
        command: what others are shown if they are refused because of it.
        beside: whether to command beside other programs of the same user.
    """
    from orientd.rpc import Robot, Way

    holder = f"orientd {command}, process {os.getpid()}"
    return Robot(
        Way.find(socket), holder=holder, beside=beside or bool(os.environ.get("ORIENTD_LEASE"))
    )


def device_settings(config: Path | None, device: str) -> DeviceSettings:
    """Return the settings of the device that a plan without a daemon is made for.

    Raises:
        RequestError: the configuration has no such device.
    """
    from orientd.config import load_or_default

    devices = load_or_default(config).devices
    if device and device not in devices:
        raise RequestError("device", f"expected one of {', '.join(devices)}, got {device!r}")
    return devices[device or next(iter(devices))]


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


_EXTRAS = {
    "record": ("mcap", "mcap_protobuf", "foxglove_schemas_protobuf"),
    "view": ("viser",),
}
"""Modules that make an optional part of orientd."""


def need_extra(extra: str) -> None:
    """Check that an optional part of orientd is installed.

    Raises:
        OrientdError: it is not; the message says how to install it.
    """
    if any(find_spec(module) is None for module in _EXTRAS[extra]):
        raise OrientdError(f"this needs the extra `{extra}`: pip install 'orientd-motion[{extra}]'")
