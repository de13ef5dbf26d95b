"""A driver that looks at motions and is never opened."""

from __future__ import annotations

from orientd.clock import MonotonicClock
from orientd.config import DeviceSettings
from orientd.driver import Driver
from orientd.driver.registry import load_driver
from orientd.errors import ConfigError


def examiner_of(settings: DeviceSettings) -> Driver:
    """Return a driver of a device that is not to be opened, to look at its motions.

    Raises:
        ConfigError: the driver is not installed, or refuses its options.
    """
    try:
        driver = load_driver(settings.driver)
    except ConfigError as error:
        raise ConfigError(f"devices.{settings.name}.driver: {error}") from error
    try:
        return driver(settings.options, period_ns=settings.period_ns, clock=MonotonicClock())
    except ValueError as error:
        raise ConfigError(f"devices.{settings.name}.options: {error}") from error
