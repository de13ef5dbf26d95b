"""What a shell completes beside commands and options: devices, families of curves, files.

Whatever goes wrong here completes nothing: a shell that waits for a word is no place for errors.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import typer

from orientd.errors import OrientdError

PATIENCE = 0.5
"""Seconds that the daemon has to answer whoever waits at a prompt."""

MOTIONS = (".yaml", ".yml", ".json")
SETTINGS = (".toml",)
TAKES = (".mcap", ".csv", ".tum", ".txt", ".db3")


def devices(context: typer.Context, incomplete: str) -> list[str]:
    """Return the devices of the daemon, or of the configuration where none answers."""
    return [name for name in _devices(context) if name.startswith(incomplete)]


def _devices(context: typer.Context) -> list[str]:
    from orientd import config
    from orientd.rpc import connect

    given = context.params.get("config")
    try:
        if given is None:
            with connect(context.params.get("socket"), timeout=PATIENCE) as robot:
                return [device.name for device in robot.devices()]
    except OrientdError:
        pass
    path = config.find() if given is None else Path(given)
    try:
        settings = config.default_settings() if path is None else config.load(path)
    except OrientdError:
        return []
    return list(settings.devices)


def files(*endings: str) -> Callable[[str], list[str]]:
    """Return what completes files with one of *endings*, and folders on the way to them."""

    def complete(incomplete: str) -> list[str]:
        folder, begun = os.path.split(incomplete)
        try:
            entries = sorted(os.scandir(Path(folder or ".").expanduser()), key=lambda one: one.name)
        except OSError:
            return []
        return [
            os.path.join(folder, one.name) + ("/" if one.is_dir() else "")  # noqa: PTH118 - as begun
            for one in entries
            if one.name.startswith(begun)
            and (begun.startswith(".") or not one.name.startswith("."))
            and (one.is_dir() or one.name.endswith(endings))
        ]

    return complete


def drawable(incomplete: str) -> list[str]:
    """Return what `orientd plot` draws: families, figures of the papers, files."""
    from orientd.curves import METHODS
    from orientd.plots import FIGURES

    named = [name for name in (*METHODS, *FIGURES) if name.startswith(incomplete)]
    return named + files(*MOTIONS, *TAKES)(incomplete)
