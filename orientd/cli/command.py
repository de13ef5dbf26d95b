"""The options that several commands share, and a command's connection to the daemon."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.parameters import Option
from orientd.errors import OrientdError, RequestError

if TYPE_CHECKING:
    from orientd.client.channel import Way
    from orientd.client.robot import Robot
    from orientd.config import DeviceSettings

PATIENCE = 0.5
"""Timeout of the daemon's list of devices when a shell completes a word, s."""


def devices(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the devices of the daemon, or of the configuration if no daemon answers.

    Errors must not appear in a shell's completion: if something fails, the result is empty.
    """
    del parameter
    from orientd import config
    from orientd.client.robot import connect

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


Socket = Annotated[
    Path | None,
    Option("--socket", help="Socket of the daemon.", envvar="ORIENTD_SOCKET", show_envvar=True),
]
Partial = Annotated[
    bool, Option("--partial", help="Read a cut or damaged recording as far as possible.")
]
Topic = Annotated[
    str, Option("--topic", "-t", help="Topic of the orientation, if there are several.")
]
DeviceName = Annotated[
    str,
    Option("--device", "-d", help="Device, if there are several.", shell_complete=devices),
]
OneOrAll = Annotated[
    str, Option("--device", "-d", help="Device; default: all.", shell_complete=devices)
]
ConfigFile = Annotated[
    Path | None,
    Option(
        "--config",
        "-c",
        help="The configuration; default: $ORIENTD_CONFIG, ~/.config/orientd/orientd.toml, or "
        "one loopback device.",
    ),
]
Host = Annotated[str, Option(help="Address to listen on; the default admits only this machine.")]
Port = Annotated[int, Option(range=(0, 65535), help="Port to listen on; 0 for any.")]
Beside = Annotated[
    bool,
    Option("--lease", help="Share the lease that your command in another terminal holds."),
]


def _checked_address(
    context: click.Context, parameter: click.Parameter, address: str | None
) -> str | None:
    del context, parameter
    if address is not None and ":" not in address:
        raise click.BadParameter(f"expected HOST:PORT or fleet:NAME, got {address!r}")
    return address


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """The options of a command that connects to the daemon."""

    socket: Socket = None
    address: Annotated[
        str | None,
        Option(
            "--address",
            metavar="HOST:PORT",
            help="Reach a daemon over TCP, with TLS; or fleet:NAME of the cell $ORIENTD_CELL.",
            callback=_checked_address,
        ),
    ] = None
    cert: Annotated[Path | None, Option("--cert", help="Your certificate (with --address).")] = None
    key: Annotated[
        Path | None, Option("--key", help="The key of your certificate (with --address).")
    ] = None
    ca: Annotated[
        Path | None,
        Option("--ca", help="The CA that signed the daemon's certificate (with --address)."),
    ] = None

    lease = False

    def way(self) -> Way:
        """Return the endpoint of the daemon.

        Raises:
            click.UsageError: certificates are given, but no address.
        """
        from orientd.client.channel import Way

        has_address = self.address or (self.socket is None and os.environ.get("ORIENTD_ADDRESS"))
        if (self.cert or self.key or self.ca) and not has_address:
            raise click.UsageError("--cert, --key and --ca need --address")
        return Way.find(self.socket, self.address, self.cert, self.key, self.ca)

    def connect(self, command: str) -> Robot:
        """Return a connection to the daemon, which its first call opens.

        The first command to a device takes its lease, or shares it if *lease* says so.

        Args:
            command: the name that others see if they are refused because of it.
        """
        from orientd.client.robot import Robot

        return Robot(
            self.way(),
            holder=f"orientd {command}, process {os.getpid()}",
            beside=self.lease or bool(os.environ.get("ORIENTD_LEASE")),
        )


@dataclass(frozen=True, kw_only=True)
class Commander(Endpoint):
    """The options of a command that commands a device."""

    device: DeviceName = ""
    lease: Beside = False


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
    """Check the suffix of a file to be written.

    Raises:
        click.BadParameter: it is not among *endings*; *named* is the parameter.
    """
    if path.suffix not in endings:
        raise click.BadParameter(
            f"expected a name that ends in {', '.join(endings)}, got {path.name!r}",
            param_hint=named,
        )


def check_picture(path: Path, *, named: str = "--plot") -> None:
    """Check the suffix of a picture to be drawn.

    Raises:
        click.BadParameter: it is no format of a picture; *named* is the parameter.
    """
    from orientd import plots

    try:
        plots.check_format(path)
    except OrientdError as error:
        raise click.BadParameter(str(error), param_hint=named) from None


_EXTRAS = {
    "batch": ("joblib", "pyarrow"),
    "mavlink": ("pymavlink",),
    "record": ("mcap", "mcap_protobuf", "foxglove_schemas_protobuf"),
    "view": ("websockets",),
}
"""Modules that make an optional part of orientd."""


def need_extra(extra: str) -> None:
    """Check that an optional part of orientd is installed.

    Raises:
        OrientdError: it is not; the message says how to install it.
    """
    if any(find_spec(module) is None for module in _EXTRAS[extra]):
        raise OrientdError(f"this needs the extra `{extra}`: pip install 'orientd-motion[{extra}]'")
