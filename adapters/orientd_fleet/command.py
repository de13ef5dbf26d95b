"""`orientd fleet`: several daemons as one cell."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from orientd.cli.command import Host, Port, Socket, need_extra
from orientd.cli.commands.record import (
    OutFile,
    Scalars,
    Seconds,
    check_output,
    ending,
    tell,
    tell_scalars,
)
from orientd.cli.commands.view import PORT, Dark, NoOpen, serve_page
from orientd.cli.output import Output, is_terminal, table
from orientd.cli.parameters import Argument, Group, Option, part_of
from orientd.errors import DaemonError, OrientdError
from orientd.one_line import shown
from orientd.protocol.reports import STALE

if TYPE_CHECKING:
    from orientd_fleet.client import Fleet
    from orientd_fleet.overview import Member, Overview
    from orientd_fleet.together import Together

fleet = Group(name="fleet", help="Monitor, stop and move several daemons as a cell.")

_REFRESH = 0.2
"""Interval between two tables on a terminal, s."""

STOP_PRIORITY = 10
"""SCHED_FIFO priority, if permitted: a stop comes before other programs."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """The options of a command that connects to a cell."""

    endpoints: Annotated[
        list[str] | None,
        Option(
            "--connect",
            metavar="ENDPOINT",
            help="Endpoint of a daemon or router; default: $ORIENTD_FLEET.",
        ),
    ] = None
    cell: Annotated[str | None, Option(help="Name of the cell; default: $ORIENTD_CELL.")] = None
    cert: Annotated[Path | None, Option(help="Your certificate; default: $ORIENTD_CERT.")] = None
    key: Annotated[
        Path | None, Option(help="The key of your certificate; default: $ORIENTD_KEY.")
    ] = None
    ca: Annotated[
        Path | None,
        Option(help="The CA that signed the cell's certificates; default: $ORIENTD_CA."),
    ] = None

    def connect(self) -> Fleet:
        """Connect to the cell."""
        from orientd_fleet.client import connect_fleet

        return connect_fleet(
            self.endpoints or None,
            cell=self.cell,
            certificate=self.cert,
            key=self.key,
            ca=self.ca,
        )


@part_of(fleet)
def serve(
    out: Output,
    config: Annotated[
        Path | None,
        Option(
            "--config",
            "-c",
            help="The daemon's configuration; default: $ORIENTD_CONFIG, or "
            "~/.config/orientd/orientd.toml.",
        ),
    ] = None,
    socket: Socket = None,
) -> None:
    """Connect a daemon to its cell, until Ctrl-C or SIGTERM.

    It is a program apart from the daemon, for the same user, and reads [fleet] of the daemon's
    configuration.  Prints one line beginning "ready" once the cell is joined.  The daemon may start
    later.  The log goes to standard error.  SIGHUP applies new roles and certificates.
    """
    from orientd.client.channel import found_socket
    from orientd.daemon.log import LogFormat, set_up_log
    from orientd.servo.realtime import set_scheduling
    from orientd_fleet.gateway import serve as serve_cell
    from orientd_fleet.settings import read_settings

    settings = read_settings(config)
    set_up_log(LogFormat.AUTO, settings.daemon.log_level)
    at = (socket or settings.daemon.socket or found_socket()).absolute()
    cell, name = settings.fleet.cell, settings.fleet.name
    # A stop must not wait for other programs; all threads inherit this.
    set_scheduling(STOP_PRIORITY)

    def ready() -> None:
        content = {"ready": True, "cell": cell, "name": name, "socket": at}
        out.answer(content, f"ready as {name} of cell {cell}, for the daemon at {at}")

    with contextlib.suppress(KeyboardInterrupt):
        serve_cell(lambda: read_settings(config), at, ready)


@part_of(fleet)
def status(
    at: Cell,
    out: Output,
    once: Annotated[bool, Option("--once", help="Print one table, even on a terminal.")] = False,
) -> None:
    """Show the state and the faults of all daemons and devices, with the age of each value.

    In a terminal the table is updated until Ctrl-C.
    """
    from orientd_fleet.overview import Overview

    with at.connect() as client, Overview(client) as overview:
        if once or out.as_json or not is_terminal():
            found = {"daemons": [_figures(member) for member in overview.members()]}
            out.answer(found, *_table(overview))
            return
        _show_live(overview)


def _show_live(overview: Overview) -> None:
    """Show the table until Ctrl-C, and write over it whenever it is shown again.

    Only what fits is shown: the cursor could not go back to lines that have scrolled away.
    """
    above = 0
    while True:
        size = shutil.get_terminal_size()
        lines = [shown(line)[: size.columns] for line in _table(overview)][: size.lines - 1]
        back = f"\x1b[{above}A\r" if above else ""
        text = "".join(f"{line}\x1b[K\n" for line in lines)
        print(f"{back}{text}\x1b[J", end="", flush=True)  # noqa: T201
        above = len(lines)
        time.sleep(_REFRESH)


def _figures(member: Member) -> dict[str, Any]:
    one = {"daemon": member.daemon, "alive": member.is_alive, "age": member.age}
    if member.age is not None:
        one |= {"age_bound": member.age_bound, "is_stale": member.age > STALE}
    return {**one, "devices": member.devices}


def _table(overview: Overview) -> list[str]:
    from orientd.cli import texts

    rows = []
    for member in overview.members():
        age = "-" if member.age is None else texts.milliseconds(member.age)
        rows += [
            [
                member.daemon,
                device.name,
                texts.state(device),
                texts.motion(device),
                age,
                member.problem or device.fault_text,
            ]
            for device in member.devices
        ]
        if not member.devices:
            rows.append([member.daemon, "-", "-", "-", age, member.problem])
    return table(["daemon", "device", "state", "motion", "age", "wrong"], rows)


@part_of(fleet)
def view(
    at: Cell,
    out: Output,
    port: Port = PORT,
    host: Host = "127.0.0.1",
    no_open: NoOpen = False,
    dark: Dark = False,
) -> None:
    """Show all devices of the cell side by side in the browser, until Ctrl-C or SIGTERM.

    Prints one line beginning "ready" with the address.  Every user who can open the page can stop
    all devices.
    """
    need_extra("view")
    from orientd_fleet.cell_view import CellView
    from orientd_fleet.overview import Overview

    with at.connect() as client, Overview(client) as overview:
        page = CellView(overview, host=host, port=port, is_dark=dark)
        serve_page(page, host, no_open=no_open, out=out)


@part_of(fleet)
def stop(
    at: Cell,
    out: Output,
    halt: Annotated[
        bool,
        Option("--halt", help="Stop as fast as the limits permit; devices may leave their paths."),
    ] = False,
) -> None:
    """Stop every device of the cell with one message, which each daemon acknowledges."""
    from orientd.servo.realtime import set_scheduling

    set_scheduling(STOP_PRIORITY)
    with at.connect() as client:
        answers = client.stop(is_quickest=halt)
    silent = [one for one in answers if one.problem]
    lines = []
    for one in answers:
        devices = ", ".join(f"{d['name']} ({str(d['state']).lower()})" for d in one.devices)
        lines.append(f"{one.daemon}: {one.problem or devices}, {one.seconds * 1e3:.1f} ms")
    out.answer({"stopped": answers}, *lines)
    if silent:
        raise DaemonError("; ".join(f"{one.daemon}: {one.problem}" for one in silent))


@part_of(fleet)
def move(
    at: Cell,
    out: Output,
    plan: Annotated[Path, Argument(metavar="PLAN", help="A YAML file with one motion per device.")],
    start_in: Annotated[
        float | None, Option(metavar="SECONDS", help="Time from the end of planning to the start.")
    ] = None,
) -> None:
    """Start devices of several daemons at the same instant, or move none.

    Ctrl-C stops all of them on their paths.
    """
    from orientd_fleet.together import move_together, read_plan

    motions, planned_in = read_plan(plan)
    if start_in is not None and not 0.0 < start_in <= 3600.0:
        raise click.BadParameter(f"expected above 0 s, got {start_in:g}", param_hint="--start-in")
    with at.connect() as client:
        together = move_together(
            client,
            motions,
            start_in=start_in or planned_in,
            holder=f"orientd fleet move, process {os.getpid()}",
            tell=out.say,
        )
    tell_together(together, out)


def tell_together(together: Together, out: Output) -> None:
    """Print the results of motions that started together.

    Raises:
        OrientdError: one of them did not end as requested.
    """
    from orientd.protocol.reports import ending as how

    ended = [
        {"daemon": one.motion.daemon, "device": one.motion.device, "plan": one.plan,
         "summary": one.summary, "problem": one.problem}
        for one in together.ended
    ]  # fmt: skip
    lines = [
        f"{one.motion}: {one.problem or (one.summary and how(one.summary))}"
        for one in together.ended
    ]
    if together.skew is not None and together.skew_bound is not None:
        lines.append(
            f"started within {together.skew * 1e3:.3f} ms of each other, "
            f"known to {together.skew_bound * 1e3:.3f} ms"
        )
    found = {"motions": ended, "skew": together.skew, "skew_bound": together.skew_bound}
    out.answer(found, *lines)
    if together.problem:
        raise OrientdError(together.problem)


@part_of(fleet)
def record(
    at: Cell,
    out: Output,
    file: OutFile,
    daemon: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Daemons to record; default: all."),
    ] = None,
    seconds: Seconds = None,
    scalars: Scalars = False,
) -> None:
    """Record every cycle, event and plan of the cell to one MCAP file, on one clock.

    Ctrl-C or SIGTERM ends it.  Open the file like one of `orientd record`; it also holds the offset
    of each clock and its bound.
    """
    check_output(file, seconds)
    tell_scalars(out, is_given=scalars)
    with at.connect() as client:
        recording = client.record(file, daemon or ())
        out.say(f"recording {', '.join(daemon or client.daemons)} to {file}")
        with ending(recording, seconds):
            recording.run()
    tell(recording, file, out)
    if recording.problems:
        raise DaemonError("; ".join(f"{name}: {why}" for name, why in recording.problems.items()))


@part_of(fleet)
def router(
    config: Annotated[
        Path,
        Option("--config", "-c", help="A configuration with [fleet] and [access.certificates]."),
    ],
    show: Annotated[
        bool, Option("--print", help="Print the configuration for `zenohd`, and exit.")
    ] = False,
) -> None:
    """Run a router of a cell until Ctrl-C: connect networks, and refuse clients without a role.

    Prints one line beginning "ready" once others can connect.
    """
    import json
    import threading

    from orientd_fleet.access import open_session, router_configuration

    configuration = router_configuration(config)
    if show:
        Output().say(json.dumps(configuration, indent=2))
        return
    with open_session(configuration):
        Output().say(f"ready at {' '.join(configuration['listen']['endpoints'])}")
        threading.Event().wait()


@part_of(fleet)
def demo(
    out: Output,
    daemons: Annotated[int, Option(range=(2, 16), help="Number of daemons.")] = 3,
) -> None:
    """Start three daemons with a device each, and one motion on all of them at once.

    They run on this machine without hardware, and end after the motion.
    """
    from orientd.motion_file import parse
    from orientd_fleet.client import connect_fleet
    from orientd_fleet.demo import cell
    from orientd_fleet.overview import Overview
    from orientd_fleet.together import FleetMotion, move_together

    with cell(daemons) as endpoint, connect_fleet(endpoint, cell="demo") as client:
        names = [f"arm-{number}" for number in range(1, daemons + 1)]
        client.find(names)
        with Overview(client) as overview:
            out.say(*_table(overview))
        request = parse({
            "keyframes": [{"rotation_vector": [0, 0, 0.8]}, {"rotation_vector": [0.4, 0.3, 0]}],
            "approach": True,
        })  # fmt: skip
        together = move_together(
            client,
            [FleetMotion(name, "", request) for name in names],
            holder="orientd fleet demo",
            tell=out.say,
        )
    tell_together(together, out)
