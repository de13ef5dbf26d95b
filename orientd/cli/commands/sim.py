"""`orientd sim`: emulated devices and a moving base, to try orientd without hardware."""

from __future__ import annotations

import importlib
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Annotated

import click

from orientd.cli.parameters import Group, Option, part_of
from orientd.errors import DaemonError

_CARRIED = Path(__file__).parents[2] / "emulators"
"""Location of the emulators in a wheel of orientd."""


def _emulator(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        sys.path.append(str(_CARRIED))
        return importlib.import_module(name)


sim = Group(
    name="sim",
    help="Run an emulated device until Ctrl-C.",
)


@part_of(sim)
def ur(
    host: Annotated[
        str, Option(help="Address to listen on, for example 127.0.0.2; each robot needs its own.")
    ],
    model: Annotated[str, Option(help="Model of the arm: ur3 to ur10, ur3e to ur30.")] = "ur5e",
    polyscope: Annotated[
        str,
        Option(help="Software version, such as 5.12.6; default: one that suits the model."),
    ] = "",
) -> None:
    """Run an emulated UR arm.

    Serves RTDE on port 30004, the dashboard on 29999, URScript on 30001 to 30003, interpreter
    mode on 30020, faults on 29998 (send `help`).  Prints a line that begins with `ready` when it
    can be used.  Any address in 127.0.0.0/8 works.
    """
    emulator = _emulator("emulated_ur")
    if model not in emulator.MODELS:
        known = ", ".join(emulator.MODELS)
        raise click.BadParameter(f"expected one of {known}, got {model!r}", param_hint="--model")
    arm = emulator.MODELS[model]
    try:
        version = emulator.version_of(arm, polyscope)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--polyscope") from error
    try:
        emulator.serve(host, emulator.Behaviour(model=arm, version=version))
    except OSError as error:
        raise DaemonError(f"cannot serve an emulated UR at {host}: {error.strerror}") from error


@part_of(sim)
def dynamixel(
    link: Annotated[Path, Option(help="Path of the serial port to create.")],
    servos: Annotated[
        str, Option(help="IDs and models of the servos, as in 1:xm430,2:xl330.")
    ] = "1:xm430,2:xm430,3:xm430",
    baud: Annotated[int, Option(help="Baud rate of the servos.")] = 1000000,
    usb_ms: Annotated[
        float,
        Option(range=(0.0, 1e4), help="Longest delay of an answer in the adapter, ms."),
    ] = 1.0,
    ideal: Annotated[bool, Option("--ideal", help="Transmit without delay.")] = False,
    seed: Annotated[int, Option(help="Random seed.")] = 0,
    console: Annotated[
        bool,
        Option("--console", help="Read commands from standard input, for example to cause faults."),
    ] = False,
) -> None:
    """Run an emulated Dynamixel bus on a pseudo-terminal.

    Prints a line that begins with `ready` when it can be used.
    """
    emulator = _emulator("emulated_dynamixel")
    line = emulator.SerialLine(
        is_paced=not ideal,
        usb_latency_ns=0 if ideal else round(usb_ms * 1e6),
        has_collisions=False,
    )
    try:
        emulator.run(
            link,
            names=servos,
            baud=baud,
            line=line,
            seed=seed,
            console=sys.stdin.fileno() if console else None,
        )
    except ValueError as error:
        raise click.BadParameter(str(error)) from error
    except OSError as error:
        raise DaemonError(
            f"cannot serve an emulated bus at {link}: {error.strerror or error}"
        ) from error


@part_of(sim)
def base(
    kind: Annotated[str, Option(help="Kind of motion: ship, vehicle or rest.")] = "ship",
    rate: Annotated[float, Option(range=(0.1, 1000.0), help="Samples per second.")] = 100.0,
    latency_ms: Annotated[float, Option(range=(0.0, 1e4), help="Delay of each sample, ms.")] = 10.0,
    dropouts: Annotated[
        float, Option(range=(0.0, 0.99), help="Share of lost samples, 0 to 0.99.")
    ] = 0.0,
    seconds: Annotated[
        float | None, Option(range=(0.0, 1e9), help="Duration; default: until Ctrl-C.")
    ] = None,
    seed: Annotated[int, Option(help="Random seed.")] = 0,
) -> None:
    """Print the orientation and rate of an emulated moving base.

    Each sample is a line of JSON for `orientd track`, with the noise and latency of an inertial
    measurement unit.
    """
    emulator = _emulator("emulated_base")
    try:
        motion = emulator.BaseMotion(kind, seed)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--kind") from error
    imu = emulator.Imu(rate_hz=rate, latency=latency_ms * 1e-3, dropouts=dropouts, seed=seed)
    emulator.run(motion, imu, seconds=math.inf if seconds is None else seconds)
