"""The key expressions of a cell.

.. code-block:: text

    orientd/CELL/DAEMON/alive/ADDRESS   liveliness token of a daemon; its calls go to ADDRESS
    orientd/CELL/DAEMON/state           GetStateResponse, some times a second
    orientd/CELL/DAEMON/clock           answers with the daemon's monotonic clock
    orientd/CELL/DAEMON/stop/CALLER     stops every device; asked of DAEMON `*`, of the cell

ADDRESS and CALLER are percent-encoded.  CALLER is the common name of the caller's certificate:
access control lets no client use another's.
"""

from __future__ import annotations

from urllib.parse import quote, unquote

ROOT = "orientd"

LOCAL = "local"
"""The caller's name in a cell without certificates."""

UNIX_ADDRESS = "unix:"
"""Prefix of the address of a control socket; any other address is ``HOST:PORT``."""

TIME_BYTES = 8
"""Of a daemon's monotonic clock, ns, little-endian: the attachment of a state, a clock's answer."""


def key_of(cell: str, daemon: str, what: str, name: str = "") -> str:
    """Return the key of *what* a daemon offers, or all daemons if *daemon* is ``*``.

    >>> key_of("lab", "*", "stop", "arm/3*"), key_of("lab", "arm-1", "alive", "**")
    ('orientd/lab/*/stop/arm%2F3%2A', 'orientd/lab/arm-1/alive/**')
    """
    parts = [ROOT, cell, daemon, what]
    if name:
        parts.append(name if name in ("*", "**") else quote(name, safe=""))
    return "/".join(parts)


def daemon_of(key: str) -> str:
    """Return the daemon in a key."""
    return key.split("/")[2]


def name_of(key: str) -> str:
    """Return the last part of a key, decoded: a caller or an address."""
    return unquote(key.rpartition("/")[2])
