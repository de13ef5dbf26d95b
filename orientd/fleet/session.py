"""A session of Zenoh: opened by our own settings, never by what happens to be on the network."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from orientd.errors import ConfigError, DaemonError

if TYPE_CHECKING:
    import zenoh


def open_session(configuration: Mapping[str, Any]) -> zenoh.Session:
    """Open a session with *configuration*: values by Zenoh's own paths.

    Raises:
        ConfigError: the extra ``fleet`` is not installed, or Zenoh refuses a value.
        DaemonError: an endpoint cannot be listened at or reached.
    """
    try:
        import zenoh
    except ImportError as error:
        raise ConfigError("a fleet needs Zenoh: pip install 'orientd-motion[fleet]'") from error
    config = zenoh.Config()
    try:
        for path, value in configuration.items():
            config.insert_json5(path, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigError(f"fleet: {_first_line(error)}") from error
    # A Unix socket that Zenoh makes is for its own user.
    before = os.umask(0o177)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        places = [*configuration["connect/endpoints"], *configuration["listen/endpoints"]]
        raise DaemonError(
            f"no member of a fleet at {', '.join(places)}, or not with this certificate: "
            f"{_first_line(error)}"
        ) from error
    finally:
        os.umask(before)


def _first_line(error: Exception) -> str:
    return str(error).partition(" at /")[0].splitlines()[0]
