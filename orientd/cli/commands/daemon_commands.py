"""Commands about the daemon: run, status, devices, methods."""

from __future__ import annotations

import logging
import os
import platform
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from orientd.cli.command import ConfigFile, Endpoint, Socket
from orientd.cli.output import Output, table
from orientd.cli.parameters import Option
from orientd.daemon.log import LogFormat
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd.protocol import control_pb2


def run(
    out: Output,
    config: ConfigFile = None,
    listen: Socket = None,
    until_end_of_input: Annotated[
        bool, Option("--until-end-of-input", help="Exit when standard input closes.")
    ] = False,
    log_format: Annotated[
        Literal["auto", "text", "json"],
        Option("--log-format", help="Format of the log; auto: json under journald, else text."),
    ] = "auto",
    require_devices: Annotated[
        bool, Option("--require-devices", help="Exit if a device is not ready.")
    ] = False,
) -> None:
    """Run the daemon in the foreground until SIGTERM or Ctrl-C.

    Prints a line that begins with "ready" once it takes commands.  Its log goes to standard error.
    If a device does not answer, the line begins with "not ready" and says why.  The daemon tries
    again, and prints "ready" once the device answers.
    """
    if not hasattr(os, "memfd_create"):
        raise OrientdError(
            f"the daemon and its servo need Linux, this is {platform.system()}; "
            "curves, plans and clients work here"
        )
    from orientd import config as configuration
    from orientd.client.channel import default_socket
    from orientd.daemon.log import set_up_log
    from orientd.daemon.server import run as serve

    path = config or configuration.find()
    settings = configuration.load_or_default(path)
    set_up_log(LogFormat(log_format), settings.daemon.log_level)
    log = logging.getLogger(__name__)
    for name, reader in settings.of_packages.items():
        log.info("daemon: [%s] is read by %s, not by the daemon", name, reader)
    if listen and settings.daemon.socket and listen != settings.daemon.socket:
        log.warning(
            "the socket is %s, by --socket or $ORIENTD_SOCKET, not the %s of %s",
            listen,
            settings.daemon.socket,
            path,
        )
    if until_end_of_input:
        threading.Thread(target=_end_with_input, name="input", daemon=True).start()

    def ready(report: control_pb2.DaemonReport, problems: list[str]) -> None:
        devices = ", ".join(
            f"{device.name} ({device.driver}, {device.rate_hz:g} Hz)"
            for device in settings.devices.values()
        )
        simulated = "" if path else "; no configuration: a simulated device, no robot"
        line = f"ready at {report.socket}: {devices}{simulated}"
        if problems:
            line = f"not ready at {report.socket}: {'; '.join(problems)}; tried again"
        content = {"ready": not problems, "problems": problems}
        out.answer({**content, "daemon": report}, line)

    serve(
        settings,
        socket=(listen or settings.daemon.socket or default_socket()).absolute(),
        configuration=str(path.absolute()) if path else "",
        reread=(lambda: configuration.load(path)) if path else None,
        on_ready=ready,
        needs_devices=require_devices,
    )


def _end_with_input() -> None:
    """Make this process end once its parent process is gone."""
    # Not sys.stdin: an interpreter that ends with an error meanwhile would block on its lock.
    while os.read(sys.stdin.fileno(), 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def status(at: Endpoint, out: Output) -> None:
    """Show the daemon, the leases and the state of each device."""
    from orientd.cli import texts

    with at.connect("status") as robot:
        report = robot.state()
    daemon = report.daemon
    lines = [
        f"daemon  orientd {daemon.version}, process {daemon.pid}, up {texts.clock(daemon.uptime)}, "
        f"at {daemon.socket}"
    ]
    for one in daemon.leases:
        of = f"of {', '.join(one.devices)}: " if len(report.devices) > 1 else ""
        whose = f" ({one.identity})" if one.identity else ""
        lines.append(f"lease   {of}{one.holder}{whose}, for another {one.remaining:.1f} s")
    if not daemon.leases:
        lines.append("lease   free")
    for device in report.devices.values():
        lines += ["", *texts.device(device)]
    out.answer(report, *lines)


def devices(at: Endpoint, out: Output) -> None:
    """List the devices of the daemon's configuration."""
    from orientd.cli import texts
    from orientd.model.limits import ANGULAR
    from orientd.protocol.limits import limits_from_message

    with at.connect("devices") as robot:
        found = robot.devices()
    rows = [
        [
            device.name,
            device.driver,
            f"{device.rate_hz:g}",
            *(texts.limit(limits_from_message(device.limits).rate(name)) for name in ANGULAR),
        ]
        for device in found
    ]
    lines = table(["name", "driver", "Hz", "rad/s", "rad/s^2", "rad/s^3"], rows)
    out.answer({"devices": found}, *lines)


def methods(
    out: Output,
    gallery: Annotated[
        Path | None,
        Option("--gallery", metavar="DIR", hidden=True, help="No longer there."),
    ] = None,
    picture_format: Annotated[str, Option("--format", hidden=True, help="No longer there.")] = "",
) -> None:
    """List the interpolation methods.  Needs no daemon."""
    from orientd.daemon.planners.reporting import known_methods

    if gallery is not None or picture_format:
        raise OrientdError(
            "orientd methods draws no gallery any more; use `orientd compare FILE --plot PICTURE`, "
            "or see the page Curves of the documentation"
        )
    found = known_methods()
    rows = [
        [
            method.name,
            *(
                "yes" if claim else "no"
                for claim in (method.interpolates, method.is_local, method.meets_end_velocities)
            ),
            method.summary,
        ]
        for method in found
    ]
    header = ["name", "interpolates", "local", "end velocities", "what it is"]
    out.answer({"methods": found}, *table(header, rows))
