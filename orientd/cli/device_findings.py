"""What the drivers of a configuration find when they look at their devices."""

from __future__ import annotations

from pathlib import Path

from orientd import config
from orientd.cli.machine import Finding, Verdict
from orientd.clock import MonotonicClock
from orientd.driver.registry import load_driver
from orientd.errors import ConfigError


def device_findings(path: Path) -> list[Finding]:
    """Return what there is to say of every device that the configuration at *path* names.

    Raises:
        ConfigError: the configuration is not well formed, or names what is not there.
    """
    found = []
    for name, settings in config.load(path).devices.items():
        driver = load_driver(settings.driver)
        try:
            device = driver(settings.options, period_ns=settings.period_ns, clock=MonotonicClock())
        except ValueError as error:
            raise ConfigError(f"devices.{name}.options: {error}") from error
        for one in device.diagnose():
            verdict = Verdict.IMPROVE if one.mend else Verdict.OK
            if one.is_problem:
                verdict = Verdict.PROBLEM
            found.append(Finding(f"{name}: {one.name}", one.found, verdict, one.mend))
    return found
