"""Routers of a cell: Zenoh's own, configured by the same tables as a daemon."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from orientd import config
from orientd.errors import ConfigError
from orientd.fleet.access import zenoh_configuration

_NO_DEVICE = {"devices": {"none": {"driver": "loopback"}}}


def router_configuration(path: Path) -> dict[str, Any]:
    """Return Zenoh's configuration of the router that the file at *path* describes.

    It has the tables ``[fleet]`` and ``[access.certificates]`` as a daemon's, and needs no devices.

    Raises:
        ConfigError: the file cannot be read or is not well formed.
    """
    settings = config.parse(_NO_DEVICE | config.read_table(path), source=str(path))
    if settings.fleet is None:
        raise ConfigError(f"{path}: fleet: missing")
    callers = list(settings.access.certificates)
    return zenoh_configuration(settings.fleet, settings.tcp, callers=callers, is_router=True)


def nested(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by Zenoh's paths as the tree that its own files hold.

    >>> nested({"mode": "router", "listen/endpoints": []})
    {'mode': 'router', 'listen': {'endpoints': []}}
    """
    tree: dict[str, Any] = {}
    for path, value in configuration.items():
        *folders, last = path.split("/")
        place = tree
        for folder in folders:
            place = place.setdefault(folder, {})
        place[last] = value
    return tree
