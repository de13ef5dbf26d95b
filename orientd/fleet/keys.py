"""The key expressions of a cell: what is published where, and where calls go.

.. code-block:: text

    orientd/CELL/DAEMON/alive               liveliness token of a daemon
    orientd/CELL/DAEMON/state               GetStateResponse, some times a second
    orientd/CELL/DAEMON/events              WatchEventsResponse, at once
    orientd/CELL/DAEMON/as/CALLER/rpc/CALL  a call of control.proto, request and answers as there
    orientd/CELL/DAEMON/as/CALLER/cancel/ID ends one of them
    orientd/CELL/DAEMON/as/CALLER/stop      stops every device; asked of DAEMON `*`, of the cell
    orientd/CELL/DAEMON/as/CALLER/clock     the daemon's monotonic clock
    orientd/CELL/DAEMON/ready/START         DAEMON takes part in a start, or has dropped it
    orientd/CELL/callers/CALLER/SESSION     liveliness token of a client

CALLER is the name in the caller's certificate: access control lets nobody use another's.
"""

from __future__ import annotations

from urllib.parse import quote, unquote

ROOT = "orientd"
LOCAL = "local"
"""The caller's name where nobody shows a certificate."""


def spelt(caller: str) -> str:
    """Return a caller's name as it stands in a key.

    >>> spelt("arm/3*")
    'arm%2F3%2A'
    """
    return quote(caller, safe="")


def of_daemon(cell: str, daemon: str, what: str) -> str:
    """Return the key of *what* a daemon, or all of them if it is ``*``, has to say."""
    return f"{ROOT}/{cell}/{daemon}/{what}"


def as_caller(cell: str, daemon: str, caller: str, what: str) -> str:
    """Return the key at which *caller* asks a daemon, or all of them, for *what*."""
    return of_daemon(cell, daemon, f"as/{spelt(caller)}/{what}")


def presence(cell: str, caller: str, session: str) -> str:
    """Return the key of a client's liveliness token; *session* may be ``*``."""
    return f"{ROOT}/{cell}/callers/{spelt(caller)}/{session}"


def all_presences(cell: str) -> str:
    """Return the key of the liveliness tokens of all clients."""
    return f"{ROOT}/{cell}/callers/*/*"


def daemon_of(key: str) -> str:
    """Return the daemon in a key."""
    return key.split("/")[2]


def last_of(key: str) -> str:
    """Return the last part of a key."""
    return key.rpartition("/")[2]


def caller_of(key: str) -> str | None:
    """Return who asks at a key; ``None`` if that is nobody in particular.

    >>> caller_of("orientd/lab/*/as/pendant/stop"), caller_of("orientd/lab/arm/as/*/stop")
    ('pendant', None)
    """
    parts = key.split("/")
    if len(parts) < 6 or parts[3] != "as" or "*" in parts[4]:
        return None
    return unquote(parts[4])
