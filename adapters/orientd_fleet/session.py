"""Open a Zenoh session with our own settings only."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from orientd.errors import ConfigError, DaemonError

if TYPE_CHECKING:
    import zenoh


def open_session(configuration: dict[str, Any]) -> zenoh.Session:
    """Open a session of Zenoh.

    Raises:
        ConfigError: the extra ``fleet`` is not installed, or Zenoh refuses a value.
        DaemonError: an endpoint cannot be listened at or reached.
    """
    try:
        import zenoh
    except ImportError as error:
        raise ConfigError("a fleet needs Zenoh: pip install 'orientd-motion[fleet]'") from error
    try:
        parsed = zenoh.Config.from_json5(json.dumps(configuration))
    except zenoh.ZError as error:
        raise ConfigError(f"fleet: {_first_line(error)}") from error
    # A Unix socket that Zenoh makes is for its own user.
    before = os.umask(0o177)
    try:
        return zenoh.open(parsed)
    except zenoh.ZError as error:
        ends = [*configuration["connect"]["endpoints"], *configuration["listen"]["endpoints"]]
        raise DaemonError(
            f"no member of a fleet at {', '.join(ends)}, or not with this certificate: "
            f"{_first_line(error)}"
        ) from error
    finally:
        os.umask(before)


def _first_line(error: Exception) -> str:
    return str(error).partition(" at /")[0].splitlines()[0]
