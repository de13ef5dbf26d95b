"""Find drivers by their entry points, those of third parties like our own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from orientd.clock import MonotonicClock
from orientd.driver.contract import Driver
from orientd.errors import ConfigError
from orientd.spelling import did_you_mean

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "orientd.drivers"


def driver_target(name: str) -> str:
    """Return the location of the driver called *name*, as ``module:Class``.

    Raises:
        ConfigError: no such driver is installed.
    """
    return _find(name).value


def load_driver(name: str) -> type[Driver]:
    """Import the driver called *name*.

    Raises:
        ConfigError: no such driver is installed, or a package that it needs is missing.
    """
    entry = _find(name)
    try:
        driver: type[Driver] = entry.load()
    except ImportError as error:
        raise ConfigError(f"driver {name!r} cannot be loaded: {error}") from error
    return driver


def make_driver(device: str, name: str, options: Mapping[str, Any], period_ns: int) -> Driver:
    """Return a driver that never opens its device, to check or plan motions.

    Args:
        device: name of the device, for messages.
        name: name of the driver.
        options: options of the driver.
        period_ns: cycle period of the device.

    Raises:
        ConfigError: the driver is not installed, or refuses its options.
    """
    try:
        driver = load_driver(name)
    except ConfigError as error:
        raise ConfigError(f"devices.{device}.driver: {error}") from error
    try:
        return driver(options, period_ns=period_ns, clock=MonotonicClock())
    except ValueError as error:
        heading = f"devices.{device}.options"
        raise ConfigError(f"{heading}: {error}; correct it below [{heading}]") from error


def _find(name: str) -> EntryPoint:
    from importlib.metadata import entry_points  # slow to load, and no servo needs it

    entries = entry_points(group=GROUP)
    for entry in entries:
        if entry.name == name:
            return entry
    known = ", ".join(sorted(entries.names)) or "none"
    near = did_you_mean(name, entries.names) or "; install its package, or name one of these"
    raise ConfigError(f"unknown driver {name!r}, installed are: {known}{near}")
