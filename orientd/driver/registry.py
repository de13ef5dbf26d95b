"""Drivers are found by entry points, so that a third party's stands beside our own."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

from orientd.driver.contract import Driver
from orientd.errors import ConfigError

GROUP = "orientd.drivers"


def driver_names() -> list[str]:
    """Return the names of the drivers that are installed."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def driver_target(name: str) -> str:
    """Return where the driver called *name* is, as ``module:Class``.

    Raises:
        ConfigError: no such driver is installed.
    """
    return _find(name).value


def load_driver(name: str) -> type[Driver]:
    """Import the driver called *name*.

    Raises:
        ConfigError: no such driver is installed, or what it needs is missing.
    """
    entry = _find(name)
    try:
        driver: type[Driver] = entry.load()
    except ImportError as error:
        raise ConfigError(f"driver {name!r} cannot be loaded: {error}") from error
    return driver


def _find(name: str) -> EntryPoint:
    found = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not found:
        known = ", ".join(driver_names()) or "none"
        raise ConfigError(f"unknown driver {name!r}, installed are: {known}")
    return found[0]
