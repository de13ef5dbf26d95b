"""`orientd doctor`: obstacles to real time, on this machine and at its devices."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.command import devices
from orientd.cli.output import Output, table, working
from orientd.cli.parameters import Option
from orientd.driver import Finding, Verdict
from orientd.errors import ConfigError, OrientdError
from orientd.one_line import counted

if TYPE_CHECKING:
    from orientd.config import DeviceSettings, Settings

SLOW_LATENCY = 0.02
"""Lag behind the setpoints above which a device counts as slow, s."""


def doctor(
    out: Output,
    config: Annotated[
        Path | None,
        Option("--config", "-c", help="Also check the devices of this configuration."),
    ] = None,
    latency: Annotated[
        str,
        Option(
            metavar="DEVICE",
            help="MOVE this device by 0.2 rad and back, and measure its latency.",
            shell_complete=devices,
        ),
    ] = "",
) -> None:
    """Check whether this machine is fit for real time.

    It also suggests fixes.  The measurement of the machine takes two seconds.  Nothing moves
    without --latency.  The exit status is 1 if there is a problem.
    """
    from orientd.cli.machine import findings

    settings = _settings(config, latency)
    with working("measuring this machine"):
        found = findings()
    if settings is not None:
        for device in settings.devices.values():
            with working(f"looking at {device.name}"):
                seen = device_findings(device)
            found += [replace(one, name=f"{device.name}: {one.name}") for one in seen]
        if latency:
            with working(f"moving {latency}"):
                found.append(latency_finding(settings.devices[latency]))
    _report(found, out)
    if any(one.verdict is Verdict.PROBLEM for one in found):
        raise click.exceptions.Exit(1)


def _settings(config: Path | None, latency: str) -> Settings | None:
    if config is None:
        if latency:
            raise click.BadParameter("needs --config", param_hint="--latency")
        return None
    from orientd import config as configuration

    settings = configuration.load(config)
    if latency and latency not in settings.devices:
        raise click.BadParameter(
            f"expected one of {', '.join(settings.devices)}, got {latency!r}",
            param_hint="--latency",
        )
    return settings


def device_findings(device: DeviceSettings) -> list[Finding]:
    """Return the findings of *device*'s driver, in its own environment.

    Raises:
        ConfigError: the driver is not installed or refuses its options.
    """
    from orientd.driver import driver_target, python_command, python_version

    device.make_driver()
    found: list[Finding] = []
    if device.python:
        try:
            version = f"{device.python}, Python {python_version(device.python)}"
        except ConfigError as error:
            mend = f"name a Python of the driver's environment as devices.{device.name}.python"
            return [Finding("interpreter", str(error), Verdict.PROBLEM, mend)]
        found.append(Finding("interpreter", version, Verdict.OK))
    target = driver_target(device.driver)
    asked = {"driver": target, "options": device.options, "period_ns": device.period_ns}
    done = subprocess.run(
        python_command(device.python, "orientd.driver.diagnosing", target),
        input=json.dumps(asked), capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        python = device.python or sys.executable
        *_, problem = done.stderr.strip().splitlines() or ["it said nothing"]
        mend = f"install what the driver needs: {python} -m pip install ..."
        return [Finding("interpreter", f"{python}: {problem}", Verdict.PROBLEM, mend)]
    return found + [Finding(a, b, Verdict(c), d) for a, b, c, d in json.loads(done.stdout)]


def latency_finding(device: DeviceSettings) -> Finding:
    """Move *device* a little and report its lag."""
    from orientd.daemon.calls.latency_identification import measure_latency

    name = f"{device.name}: latency"
    try:
        got = measure_latency(device)
    except OrientdError as error:
        mend = "see the other rows of the device; no daemon may be running with it"
        return Finding(name, str(error), Verdict.PROBLEM, mend)
    found = (
        f"{1e3 * got.seconds:.1f} ms from setpoint to feedback; error {got.error:.4f} rad, "
        f"{got.error_led:.4f} rad when led by it"
    )
    if got.seconds <= SLOW_LATENCY:
        return Finding(name, found, Verdict.OK)
    mend = (
        f"`latency = {got.seconds:.3f}` and `compensate_latency = true` in [devices.{device.name}]"
    )
    return Finding(name, found, Verdict.IMPROVE, mend)


def _report(found: list[Finding], out: Output) -> None:
    count = {verdict: sum(one.verdict is verdict for one in found) for verdict in Verdict}
    rows = [[one.verdict.value, one.name, one.found] for one in found]
    out.answer(
        {"findings": found, "counts": {one.value: number for one, number in count.items()}},
        *table(["verdict", "what", "found"], rows),
        "",
        *(f"{one.name}: {one.mend}" for one in found if one.mend),
        f"{count[Verdict.OK]} ok, {count[Verdict.IMPROVE]} to improve, "
        f"{counted(count[Verdict.PROBLEM], 'problem')}",
    )
